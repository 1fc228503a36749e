/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How much of the signal of each zone is the light of a packet. */
#ifndef RETROLIDAR_AMPLITUDE_H
#define RETROLIDAR_AMPLITUDE_H

#include "retrolidar_ranging.h"
#include "retrolidar_samples.h"

/* Fit of the light to the signal of each zone: gain, its variance, and the residual variance. */
struct rl_amplitude {
    double of[RL_MAX_ZONES], variance[RL_MAX_ZONES], noise[RL_MAX_ZONES];
    /* By the samples in which the packet is dark, as these do not show how its gain changes: the
     * gain's variance, and light that is not known, in the unit of the gain.
     */
    double dark_variance[RL_MAX_ZONES], unknown[RL_MAX_ZONES];
    double score[RL_MAX_ZONES]; /* correlation of the signal with the light */
};

/* Fit the light of a packet, and of others that are known, to the signal of a zone. */
void rl_fit_amplitude(const struct rl_samples *samples, const struct rl_seen *seen, int zone,
                      struct rl_amplitude *amplitude);

#endif
