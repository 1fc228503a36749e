/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A gain that changes during a packet, of a marker that moves or in light that sways: it is linear
 * between RL_KNOTS knots, equally spaced over the rows of a window.
 */
#ifndef RETROLIDAR_GAIN_PROFILE_H
#define RETROLIDAR_GAIN_PROFILE_H

#include "retrolidar_constants.h"
#include "retrolidar_whitened.h"

#include <stdbool.h>

/* A template of less energy is constant in the window. */
static const double RL_NO_ENERGY = 1e-9;

/* Products of the light on each two knots, of which the lower triangle is used, and with the
 * signal, for every walk.
 */
struct rl_knot_products {
    double normal[RL_KNOTS][RL_KNOTS][RL_WALK_LANES], right[RL_KNOTS][RL_WALK_LANES];
};

/* What a gain that changes must explain besides a steady one [nats]. */
static inline double rl_price_of_profile(void)
{
    return RL_COST_OF_GAIN * (RL_KNOTS - 1);
}

/* The gain in a row. */
double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows);

/* The part of the light of each row that is on a knot. */
void rl_light_on_knot(int knot, const double *light, int rows, double *part);

/* Least squares, for every walk.
 *
 * may_darken: whether gains may be negative
 * explained: becomes by how much the gains lower the squares
 */
void rl_knots_solve(const struct rl_knot_products *products, bool may_darken,
                    double gain[RL_KNOTS][RL_WALK_LANES], double explained[RL_WALK_LANES]);

#endif
