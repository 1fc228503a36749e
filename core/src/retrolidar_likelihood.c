/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_likelihood.h"

#include <math.h>
#include <string.h>

/* The last lane repeats the one before it, so that vectors of two are full. */
static const double WALK[RL_WALK_LANES] = {0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 30.0, 30.0};

int64_t rl_whitened_doubles(int rows)
{
    return (int64_t)rows * (3 * RL_WALK_LANES + 1);
}

void rl_whitened_start(struct rl_whitened *whitened, int rows, double *memory)
{
    memset(whitened, 0, sizeof *whitened);
    whitened->gain = (double(*)[RL_WALK_LANES])memory;
    whitened->scale = whitened->gain + rows;
    whitened->signal = whitened->scale + rows;
    whitened->row = (int *)(whitened->signal + rows);
}

static double log_likelihood(const struct rl_whitened *whitened, int walk, double squares,
                             int parameters, double *variance)
{
    const double innovations = whitened->samples - 1;
    *variance = fmax(squares / fmax(innovations - parameters, 1.0), whitened->least);
    return -0.5 * innovations * log(*variance) - 0.5 * squares / *variance +
           whitened->log_scales[walk];
}

void rl_whiten(struct rl_whitened *whitened, const float *signal, const uint8_t *valid,
               const double *begin_s, const double *end_s, int rows, double period_s, double least)
{
    double variance[RL_WALK_LANES], level[RL_WALK_LANES], product[RL_WALK_LANES];
    double squares[RL_WALK_LANES] = {0.0};
    double last_s = 0.0, first = 0.0;
    int samples = 0;
    whitened->least = least;
    memset(whitened->log_scales, 0, sizeof whitened->log_scales);
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        product[walk] = 1.0;
    }
    for (int row = 0; row < rows; row++) {
        if (!valid[row]) {
            continue;
        }
        const double value = signal[row];
        const double middle_s = (begin_s[row] + end_s[row]) / 2;
        const double periods = (middle_s - last_s) / period_s;
        double *gain = whitened->gain[samples], *scale = whitened->scale[samples];
        double *white = whitened->signal[samples];
        whitened->row[samples] = row;
        last_s = middle_s;
        if (samples++ == 0) {
            /* The level is unknown, so the first sample only sets it. */
            first = value;
            for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                variance[walk] = 1.0;
                level[walk] = 0.0;
                gain[walk] = scale[walk] = white[walk] = 0.0;
            }
            continue;
        }
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double predicted = variance[walk] + WALK[walk] * periods;
            const double per_total = 1.0 / (predicted + 1.0);
            const double innovation = value - first - level[walk];
            gain[walk] = predicted * per_total;
            scale[walk] = sqrt(per_total);
            white[walk] = innovation * scale[walk];
            squares[walk] += white[walk] * white[walk];
            level[walk] += gain[walk] * innovation;
            variance[walk] = gain[walk];
            product[walk] *= per_total;
        }
        if (samples % 16 == 0) {
            for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                whitened->log_scales[walk] += 0.5 * log(product[walk]);
                product[walk] = 1.0;
            }
        }
    }
    whitened->samples = samples;
    whitened->null = -INFINITY;
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        double ignored;
        whitened->log_scales[walk] += 0.5 * log(product[walk]);
        whitened->squares[walk] = squares[walk];
        whitened->null =
            fmax(whitened->null, log_likelihood(whitened, walk, squares[walk], 0, &ignored));
    }
}

struct rl_gain rl_fit_gain(const struct rl_whitened *whitened, const double *light)
{
    double level[RL_WALK_LANES] = {0.0}, cross[RL_WALK_LANES] = {0.0};
    double power[RL_WALK_LANES] = {0.0};
    struct rl_gain best = {whitened->null, 0.0, whitened->least, 0};
    if (whitened->samples < 3) {
        return best;
    }
    const double first = light[whitened->row[0]];
    for (int sample = 1; sample < whitened->samples; sample++) {
        const double value = light[whitened->row[sample]] - first;
        const double *gain = whitened->gain[sample], *scale = whitened->scale[sample];
        const double *signal = whitened->signal[sample];
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double innovation = value - level[walk];
            const double white = innovation * scale[walk];
            level[walk] += gain[walk] * innovation;
            cross[walk] += white * signal[walk];
            power[walk] += white * white;
        }
    }
    for (int walk = 0; walk < RL_WALKS; walk++) {
        if (!(cross[walk] > 0.0) || !(power[walk] > 1e-9)) {
            continue;
        }
        double variance;
        const double explained = cross[walk] * cross[walk] / power[walk];
        const double squares = fmax(whitened->squares[walk] - explained, 0.0);
        const double likelihood = log_likelihood(whitened, walk, squares, 1, &variance);
        if (likelihood > best.log_likelihood) {
            best = (struct rl_gain){likelihood, cross[walk] / power[walk], variance, walk};
        }
    }
    return best;
}
