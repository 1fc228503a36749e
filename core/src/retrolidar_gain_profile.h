/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How the gain of a packet changes while it is sent: a marker that moves, or a light that sways. */
#ifndef RETROLIDAR_GAIN_PROFILE_H
#define RETROLIDAR_GAIN_PROFILE_H

#include "retrolidar_constants.h"

#include <stdint.h>

enum { RL_KNOTS = RL_PARTS - 1 };

/* What the knots of a gain that changes must explain [nats]: a steady one has one. */
static inline double rl_price_of_profile(void)
{
    return RL_COST_OF_GAIN * (RL_KNOTS - 1);
}

struct rl_gain_profile {
    double nats;          /* by which it explains the steps better than nothing, less its price */
    double cross, energy; /* whose ratio is the gain, if it does not change */
};

/* Fit a gain that is linear between so many knots, equally spaced over the rows, to the steps from
 * row to row, on which a level that wanders has little bearing.
 *
 * light: of the packet in each row
 */
struct rl_gain_profile rl_gain_profile_fit(const float *signal, const uint8_t *valid,
                                           const double *light, int rows, double gain[RL_KNOTS]);

/* The gain in a row. */
double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows);

#endif
