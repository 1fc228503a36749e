/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A gain that changes during a packet, of a marker that moves or in light that sways: it is linear
 * between RL_KNOTS knots, equally spaced over the rows of a window.
 */
#ifndef RETROLIDAR_GAIN_PROFILE_H
#define RETROLIDAR_GAIN_PROFILE_H

#include "retrolidar_constants.h"

#include <stdbool.h>

/* A template of less energy is constant in the window. */
static const double RL_NO_ENERGY = 1e-9;
enum { RL_KNOTS = RL_PARTS - 1 };

/* What a gain that changes must explain besides a steady one [nats]. */
static inline double rl_price_of_profile(void)
{
    return RL_COST_OF_GAIN * (RL_KNOTS - 1);
}

/* The gain in a row. */
double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows);

/* How much of the light of a row is on a knot, 0 to 1. */
double rl_knot_weight(int knot, int row, int rows);

/* Least squares. Return by how much the gains lower the squares.
 *
 * normal: products of the light on each two knots, the lower triangle
 * right: products with the signal
 * may_darken: whether gains may be negative
 */
double rl_knots_solve(double normal[RL_KNOTS][RL_KNOTS], const double right[RL_KNOTS],
                      bool may_darken, double gain[RL_KNOTS]);

#endif
