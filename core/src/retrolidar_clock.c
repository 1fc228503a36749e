/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether the light blinks at our bit period, or at another one that looks like it. */
#include "retrolidar_decide.h"

#include <math.h>
#include <string.h>

enum { MAX_BITS = 256 };
/* Bit periods that are tried, over ours. */
static const double MIN_RATIO = 0.5, MAX_RATIO = 4.0;
/* The ends of a packet move by a phase from one period to the next. */
static const double STEP = 1.0 + 2.0 / (RL_PHASES * RL_PACKET_BITS);
static const double MAX_CORRELATION = 0.999;

/* What each bit more than ours must explain, as more bits also fit noise. If it were more, clocks
 * that are off by a tenth would be read as other IDs [nats].
 */
static const double COST_OF_BIT = 1.5;

/* A clock: when bits begin, and how long they are. */
struct clock {
    float nats; /* about, the log likelihood */
    int bits;
    double begin_s, bit_s;
};

/* A window, the zone of it that sees most, the mean of its dark and its bright level, and half of
 * the step between them.
 */
struct slicer {
    struct rl_window *window;
    const struct rl_window *seen;
    float middle, half;
    float beyond[MAX_BITS]; /* sum over the samples of each bit, less the middle level */
};

/* Of the packet that was tried last. */
static struct slicer slicer_of(struct rl_window *window)
{
    const struct rl_column column = window->strongest->column;
    float level[2] = {0.0f, 0.0f}, count[2] = {1e-9f, 1e-9f};
    for (int row = 0; row < window->rows; row++) {
        const int bright = window->light[row] > 0.5;
        level[bright] += column.valid[row] ? column.signal[row] : 0.0f;
        count[bright] += column.valid[row];
    }
    level[0] /= count[0];
    level[1] /= count[1];
    return (struct slicer){.window = window,
                           .seen = window->strongest,
                           .middle = (level[0] + level[1]) / 2,
                           .half = (level[1] - level[0]) / 2};
}

/* Sort the samples into the bits of a clock, and give each bit the nearer level. */
static void slice(struct slicer *slicer, struct clock *clock)
{
    const struct rl_window *window = slicer->seen;
    const float half = slicer->half;
    const float least = (float)window->whitened.least;
    const double per_s = 1.0 / clock->bit_s;
    float squares = 0.0f, count = 0.0f;
    clock->bits = 0;
    for (int row = 0; row < window->rows; row++) {
        const double middle_s = (window->begin_s[row] + window->end_s[row]) / 2;
        const int bit = (int)((middle_s - clock->begin_s) * per_s);
        for (; clock->bits <= bit && clock->bits < MAX_BITS; clock->bits++) {
            slicer->beyond[clock->bits] = 0.0f;
        }
        if (window->column.valid[row] && bit < MAX_BITS) {
            const float beyond = window->column.signal[row] - slicer->middle;
            slicer->beyond[bit] += beyond;
            squares += beyond * beyond + half * half;
            count += 1.0f;
        }
    }
    for (int bit = 0; bit < clock->bits; bit++) {
        squares -= 2.0f * half * fabsf(slicer->beyond[bit]);
    }
    clock->nats = -0.5f * count * logf(fmaxf(squares, count * least)) -
                  (float)COST_OF_BIT * (float)clock->bits;
}

/* Log likelihood of the bits that a clock shows. */
static double try_clock(struct slicer *slicer, struct clock *clock)
{
    struct rl_window *window = slicer->window;
    slice(slicer, clock);
    for (int row = 0; row < window->rows; row++) {
        const double from = (window->begin_s[row] - clock->begin_s) / clock->bit_s;
        const double to = (window->end_s[row] - clock->begin_s) / clock->bit_s;
        double bright = 0.0;
        for (int bit = (int)fmax(from, 0.0); bit < to && bit < clock->bits; bit++) {
            const double part = fmin(to, bit + 1.0) - fmax(from, bit);
            bright += slicer->beyond[bit] > 0.0f ? part : 0.0;
        }
        window->light[row] = bright / (to - from);
    }
    return rl_window_fit(window, window->light);
}

double rl_clock_excess(struct rl_window *window, const struct rl_transmission *transmission,
                       double own)
{
    rl_window_try(window, transmission);
    struct slicer slicer = slicer_of(window);
    struct clock best[RL_TRIED];
    double excess = -INFINITY;
    int count = 0;
    const double usual_s = (window->min_bit_s + window->max_bit_s) / 2;
    const double begin_s = window->begin_s[0];
    for (double ratio = MIN_RATIO; ratio <= MAX_RATIO; ratio *= STEP) {
        /* Periods near ours are ours. */
        for (int phase = 0; phase < RL_PHASES && fabs(ratio - 1.0) > 1.5 * RL_MAX_SKEW; phase++) {
            struct clock clock = {.bit_s = ratio * usual_s};
            clock.begin_s = begin_s - phase * clock.bit_s / RL_PHASES;
            slice(&slicer, &clock);
            rl_keep_best(best, &count, RL_TRIED, &clock, sizeof clock);
        }
    }
    const double end_s = window->end_s[window->rows - 1];
    const double ours = (end_s - begin_s) / transmission->bit_s;
    for (int i = 0; i < count; i++) {
        const double likelihood = try_clock(&slicer, &best[i]);
        excess = fmax(excess, likelihood - own - COST_OF_BIT * fmax(best[i].bits - ours, 0.0));
    }
    return excess;
}

/* Log likelihood ratio of a signal that repeats after a lag, from its autocorrelation. */
static double repeats(const float *signal, int rows, int lag)
{
    float cross = 0.0f, power = 1e-9f;
    for (int row = lag; row < rows; row++) {
        cross += signal[row] * signal[row - lag];
        power += (signal[row] * signal[row] + signal[row - lag] * signal[row - lag]) / 2;
    }
    const double correlation = fmin((double)fmaxf(cross / power, 0.0f), MAX_CORRELATION);
    return -0.5 * (rows - lag) * log(1.0 - correlation * correlation);
}

double rl_clock_period_excess(struct rl_window *window, const struct rl_transmission *transmission)
{
    const struct rl_samples *samples = window->samples;
    const int oldest = rl_samples_oldest(samples), rows = samples->count - oldest;
    const double bit_rows = transmission->bit_s / samples->period_s;
    const double packet_rows = RL_PACKET_BITS * bit_rows;
    rl_window_try(window, transmission);
    const struct rl_column column = rl_target_column(samples, window->strongest->channel, oldest,
                                                     rows, window->is_dimmer, &window->room);
    float *signal = window->room.signal;
    memmove(signal, column.signal, (size_t)rows * sizeof *signal);
    const int block = (int)packet_rows + 1;
    for (int first = 0; first < rows; first += block) {
        const int count = first + block < rows ? block : rows - first;
        float sum = 0.0f;
        for (int row = 0; row < count; row++) {
            sum += signal[first + row];
        }
        for (int row = 0; row < count; row++) {
            signal[first + row] -= sum / (float)count;
        }
    }
    double ours = 0.0, other = 0.0;
    for (int lag = (int)(RL_PREAMBLE_BITS * bit_rows); lag < rows / 2; lag++) {
        const double packets = lag / packet_rows;
        const double off_rows = fabs(packets - floor(packets + 0.5)) * packet_rows;
        const double nats = repeats(signal, rows, lag);
        if (packets > 0.5 && off_rows <= 1.5 * bit_rows) {
            ours = fmax(ours, nats);
        } else {
            other = fmax(other, nats);
        }
    }
    return other - ours;
}
