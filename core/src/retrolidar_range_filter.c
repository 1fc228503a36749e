/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Range and range rate of a marker that is followed: an interacting multiple model filter (Blom and
 * Bar-Shalom 1988). A marker rests, moves evenly, turns as what swings does, or changes its rate at
 * once; the models weigh themselves by how well they predict.
 */
#include "retrolidar_followed.h"

#include <math.h>

enum { STILL, EVEN, TURNING, CHANGED };

/* All these numbers are fitted to emulated markers that rest, go to and fro evenly, swing, are
 * carried by hand, or go and stop, at 1 and 2 m: by likelihood, error and normalised error of their
 * ranges.
 */
/* How often one motion becomes another [1/s]. */
static const double RATE[RL_MOTIONS][RL_MOTIONS] = {
    {0.0, 1e-5, 4e-5, 3e-4},
    {7e-4, 0.0, 7e-4, 0.4},
    {1e-4, 0.01, 0.0, 0.6},
    {2e-4, 0.7, 0.4, 0.0},
};
/* Spectral density of the acceleration [m^2/s^3], and of the position at rest [m^2/s]. */
static const double ACCELERATION[RL_MOTIONS] = {0.0, 3e-6, 1.0, 0.01};
static const double TREMBLE = 1e-9;
static const double SLOWS[RL_MOTIONS] = {0.0, 0.1, 2.5, 0.0}; /* share of the rate lost [1/s] */
/* Deviations of a rate that is not known, and of one at rest [m/s]. */
static const double ANY_RATE = 0.5, REST_RATE = 1e-3;
/* Deviation of the rate after rest, by the motion that begins [m/s]. */
static const double BEGUN_RATE[RL_MOTIONS] = {0.0, 0.5, 0.02, 2e-4};
static const double FIRST_CHANCE[RL_MOTIONS] = {0.4, 0.2, 0.3, 0.1};
static const double MIN_CHANCE = 1e-12, MIN_VARIANCE = 1e-10;

void rl_range_start(struct rl_range_filter *filter, double range_m, double variance)
{
    for (int i = 0; i < RL_MOTIONS; i++) {
        const double rate = i == STILL ? REST_RATE : ANY_RATE;
        filter->chance[i] = FIRST_CHANCE[i];
        filter->motion[i] = (struct rl_motion){range_m, 0.0, variance, 0.0, rate * rate};
    }
}

/* Mean and covariance of motions with such weights, whose sum is `total`. */
static struct rl_motion mixture(const struct rl_motion *motions, const double *weight, double total)
{
    struct rl_motion mean = {.range_m = 0.0};
    for (int i = 0; i < RL_MOTIONS; i++) {
        mean.range_m += weight[i] / total * motions[i].range_m;
        mean.rate += weight[i] / total * motions[i].rate;
    }
    for (int i = 0; i < RL_MOTIONS; i++) {
        const struct rl_motion *one = &motions[i];
        const double off_m = one->range_m - mean.range_m, off = one->rate - mean.rate;
        const double share = weight[i] / total;
        mean.variance += share * (one->variance + off_m * off_m);
        mean.common += share * (one->common + off_m * off);
        mean.rate_variance += share * (one->rate_variance + off * off);
    }
    return mean;
}

static void move(struct rl_motion *one, int motion, double step_s)
{
    if (motion == STILL) {
        one->variance += TREMBLE * step_s;
        one->rate = one->common = 0.0;
        one->rate_variance = REST_RATE * REST_RATE;
        return;
    }
    const double noise = ACCELERATION[motion] * step_s, kept = exp(-SLOWS[motion] * step_s);
    one->rate *= kept;
    one->common *= kept;
    one->rate_variance *= kept * kept;
    one->range_m += one->rate * step_s;
    one->variance +=
        step_s * (2.0 * one->common + step_s * one->rate_variance) + noise * step_s * step_s / 3.0;
    one->common += step_s * one->rate_variance + noise * step_s / 2.0;
    one->rate_variance = fmin(one->rate_variance + noise, 4.0 * ANY_RATE * ANY_RATE);
}

/* The state of a motion as it changes to another one. */
static struct rl_motion begin(const struct rl_motion *from, int motion, int to)
{
    struct rl_motion begun = *from;
    if (motion == STILL && to != STILL) {
        begun.rate_variance = BEGUN_RATE[to] * BEGUN_RATE[to];
    }
    if (motion != CHANGED && to == CHANGED) { /* as fast as before, either way */
        begun.rate_variance += begun.rate * begun.rate;
        begun.rate = begun.common = 0.0;
    }
    return begun;
}

void rl_range_predict(struct rl_range_filter *filter, double step_s)
{
    struct rl_range_filter after;
    for (int to = 0; to < RL_MOTIONS; to++) {
        struct rl_motion before[RL_MOTIONS];
        double weight[RL_MOTIONS], total = 0.0;
        for (int from = 0; from < RL_MOTIONS; from++) {
            double all = 0.0;
            for (int i = 0; i < RL_MOTIONS; i++) {
                all += RATE[from][i];
            }
            const double left = 1.0 - exp(-all * step_s);
            const double change = from == to ? 1.0 - left : left * RATE[from][to] / all;
            before[from] = begin(&filter->motion[from], from, to);
            weight[from] = change * filter->chance[from];
            total += weight[from];
        }
        after.chance[to] = total;
        after.motion[to] = mixture(before, weight, total);
        move(&after.motion[to], to, step_s);
    }
    *filter = after;
}

void rl_range_update(struct rl_range_filter *filter, double range_m, double variance, double share)
{
    double nats[RL_MOTIONS], most = -INFINITY, total = 0.0;
    for (int i = 0; i < RL_MOTIONS; i++) {
        struct rl_motion *one = &filter->motion[i];
        const double innovation = share * (range_m - one->range_m);
        const double spread = share * share * one->variance + variance;
        const double gain = share * one->variance / spread;
        const double rate_gain = share * one->common / spread;
        one->range_m += gain * innovation;
        one->rate += rate_gain * innovation;
        one->rate_variance -= rate_gain * share * one->common;
        one->common -= gain * share * one->common;
        one->variance = fmax(one->variance - gain * share * one->variance, MIN_VARIANCE);
        one->rate_variance = fmax(one->rate_variance, MIN_VARIANCE);
        nats[i] = log(filter->chance[i]) - (innovation * innovation / spread + log(spread)) / 2.0;
        most = fmax(most, nats[i]);
    }
    for (int i = 0; i < RL_MOTIONS; i++) {
        filter->chance[i] = fmax(exp(nats[i] - most), MIN_CHANCE);
        total += filter->chance[i];
    }
    for (int i = 0; i < RL_MOTIONS; i++) {
        filter->chance[i] /= total;
    }
}

struct rl_motion rl_range_estimate(const struct rl_range_filter *filter)
{
    return mixture(filter->motion, filter->chance, 1.0);
}
