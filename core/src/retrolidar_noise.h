/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How much samples vary: by the law of the sensor's noise, and in fact. */
#ifndef RETROLIDAR_NOISE_H
#define RETROLIDAR_NOISE_H

#include "retrolidar_samples.h"

/* Variance of the noise of a channel at a signal [(kcps/SPAD)^2], as the law says. */
double rl_noise_variance(const struct rl_samples *samples, int channel, double signal);

/* After a row was appended: update the sums to the newest rows, as many as `wanted`; `recompute`
 * them after the rows have moved.
 */
void rl_noise_follow(struct rl_samples *samples, int wanted, bool recompute);

/* By how many times its noise a channel varies over the newest `variance_rows`. */
double rl_noise_variation(const struct rl_samples *samples, int channel);

#endif
