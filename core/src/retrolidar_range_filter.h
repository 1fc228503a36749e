/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Range and range rate of a marker that is followed: an interacting multiple model filter (Blom and
 * Bar-Shalom 1988). A marker rests, moves evenly, turns as what swings does, or changes its rate at
 * once; the models weigh themselves by how well they predict.
 */
#ifndef RETROLIDAR_RANGE_FILTER_H
#define RETROLIDAR_RANGE_FILTER_H

enum { RL_MOTIONS = 4 };

struct rl_motion {
    double chance;
    double range_m, rate;                   /* [m], [m/s] */
    double variance, common, rate_variance; /* of the range, of both, of the rate */
};

struct rl_range_filter {
    struct rl_motion motion[RL_MOTIONS];
};

void rl_range_start(struct rl_range_filter *filter, double range_m, double variance);

void rl_range_predict(struct rl_range_filter *filter, double step_s);

/* Update with a measured range, of which a share shows the marker's and the rest is known. */
void rl_range_update(struct rl_range_filter *filter, double range_m, double variance, double share);

/* The mean and the covariance of all motions, whose chance is 1. */
struct rl_motion rl_range_estimate(const struct rl_range_filter *filter);

#endif
