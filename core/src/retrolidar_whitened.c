/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Samples of a channel in a window, whitened, and their likelihood without a packet. */
#include "retrolidar_likelihood.h"

#include <math.h>
#include <string.h>

/* The last lane repeats the one before it, to fill vectors of two. */
static const double Q_OVER_R[RL_WALK_LANES] = {0.0, 0.003, 0.01, 0.03, 0.1,
                                               0.3, 1.0,   3.0,  30.0, 30.0};

void rl_whitened_start(struct rl_whitened *whitened, int rows, struct rl_memory *memory)
{
    memset(whitened, 0, sizeof *whitened);
    whitened->gain = rl_take(memory, rows, sizeof *whitened->signal);
    whitened->scale = rl_take(memory, rows, sizeof *whitened->signal);
    whitened->signal = rl_take(memory, rows, sizeof *whitened->signal);
    for (int i = 0; i < RL_MAX_INTERFERERS + RL_KNOTS; i++) {
        whitened->interferer[i] = rl_take(memory, rows, sizeof *whitened->signal);
    }
    whitened->row = rl_take(memory, rows, sizeof(int));
}

double rl_log_likelihood(const struct rl_whitened *whitened, int walk, double squares,
                         int parameters)
{
    const double innovations = whitened->samples - 1;
    parameters += whitened->interferers;
    const double variance =
        fmax(squares / fmax(innovations - parameters, 1.0), whitened->least);
    return -0.5 * innovations * log(variance) - 0.5 * squares / variance +
           whitened->log_scales[walk];
}

void rl_find_null(struct rl_whitened *whitened)
{
    whitened->null = -INFINITY;
    for (int walk = 0; walk < RL_WALKS; walk++) {
        const double one = rl_log_likelihood(whitened, walk, whitened->squares[walk], 0);
        if (one > whitened->null) {
            whitened->null = one;
            whitened->null_walk = walk;
        }
    }
}

void rl_whiten(struct rl_whitened *whitened, const float *signal, const uint8_t *valid,
               const double *begin_s, const double *end_s, int rows, double period_s, double least)
{
    double variance[RL_WALK_LANES], level[RL_WALK_LANES], product[RL_WALK_LANES];
    double squares[RL_WALK_LANES] = {0.0};
    double last_s = 0.0, first = 0.0;
    int samples = 0;
    whitened->least = least;
    whitened->interferers = 0;
    memset(whitened->log_scales, 0, sizeof whitened->log_scales);
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        variance[walk] = product[walk] = 1.0;
        level[walk] = 0.0;
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
                gain[walk] = scale[walk] = white[walk] = 0.0;
            }
            continue;
        }
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double predicted = variance[walk] + Q_OVER_R[walk] * periods;
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
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        whitened->log_scales[walk] += 0.5 * log(product[walk]);
        whitened->squares[walk] = squares[walk];
    }
    rl_find_null(whitened);
}

void rl_unwhiten(const struct rl_whitened *whitened, float *signal)
{
    /* To follow the light of packets that are not known yet, a level would have to wander; but then
     * the gains of the known ones are fitted to single steps, which are both's.
     */
    const int walk = whitened->null_walk < RL_WANDERS ? whitened->null_walk : RL_WANDERS - 1;
    double level = 0.0;
    if (whitened->samples == 0) {
        return;
    }
    const double first = (double)signal[whitened->row[0]];
    for (int sample = 1; sample < whitened->samples; sample++) {
        const double innovation = whitened->signal[sample][walk] / whitened->scale[sample][walk];
        signal[whitened->row[sample]] = (float)(first + level + innovation);
        level += whitened->gain[sample][walk] * innovation;
    }
}
