/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_target.h"

#include "retrolidar_constants.h"
#include "retrolidar_math.h"

#include <math.h>
#include <string.h>

/* A nearer target passes by if fewer of the frames show it. */
static const double PASSING = 0.2;
/* A target that appears more often, as a cover glass, is seen while the marker is dark. */
static const int MAX_PASSES = 3;

enum {
    FINE = 256, /* steps of a bin ... */
    BINS = 128, /* ... and such bins, up to the farthest that the sensor measures */
};

/* Histogram of the measured distances. */
struct bins {
    float gap_m, steps_a_metre;
    int all, count[BINS];
    float nearest[BINS], farthest[BINS];
};

static int step_of(const struct bins *bins, float distance)
{
    const int step = (int)(distance * bins->steps_a_metre);
    return step < FINE * BINS ? step : FINE * BINS - 1;
}

static void sort_into(struct bins *bins, const float *distance, int rows, float least)
{
    memset(bins->count, 0, sizeof bins->count);
    bins->all = 0;
    for (int bin = 0; bin < BINS; bin++) {
        bins->nearest[bin] = INFINITY;
        bins->farthest[bin] = 0.0f;
    }
    for (int row = 0; row < rows; row++) {
        if (distance[row] >= least) {
            const int bin = step_of(bins, distance[row]) / FINE;
            bins->nearest[bin] = rl_minf(bins->nearest[bin], distance[row]);
            bins->farthest[bin] = rl_maxf(bins->farthest[bin], distance[row]);
            bins->count[bin]++;
            bins->all++;
        }
    }
}

/* The bin that holds a rank; the rank becomes that within the bin. */
static int place_of(const int *counts, int *rank)
{
    int at = 0;
    for (; counts[at] <= *rank; at++) {
        *rank -= counts[at];
    }
    return at;
}

/* Median of the distances, to a step of a bin. */
static float middle_of(const struct bins *bins, const float *distance, int rows)
{
    int count[FINE] = {0}, rank = bins->all / 2;
    const int bin = place_of(bins->count, &rank);
    for (int row = 0; row < rows; row++) {
        if (distance[row] > 0.0f && step_of(bins, distance[row]) / FINE == bin) {
            count[step_of(bins, distance[row]) % FINE]++;
        }
    }
    return (float)(bin * FINE + place_of(count, &rank)) / bins->steps_a_metre;
}

/* The widest gap between distances, if it is wider than a bin, and its middle. */
static float widest_gap(const struct bins *bins, float *middle)
{
    float widest = 0.0f, before = INFINITY;
    for (int bin = 0; bin < BINS; bin++) {
        if (bins->count[bin] > 0) {
            if (bins->nearest[bin] - before > widest) {
                widest = bins->nearest[bin] - before;
                *middle = (bins->nearest[bin] + before) / 2;
            }
            before = bins->farthest[bin];
        }
    }
    return widest;
}

/* The distance below which a target passes by; 0 if none does. */
static float passing_by(const struct bins *bins, const float *distance, int rows)
{
    int passing = 0, passes = 0, rank = bins->all / 2, near = 0;
    while (bins->count[near] == 0) {
        near++;
    }
    if ((place_of(bins->count, &rank) + 1 - near) * FINE < bins->gap_m * bins->steps_a_metre) {
        return 0.0f;
    }
    const float nearer = middle_of(bins, distance, rows) - bins->gap_m;
    for (int row = 0, before = 0; row < rows; row++) {
        const int now = isnan(distance[row]) ? before : distance[row] < nearer;
        passing += now && !isnan(distance[row]);
        passes += now > before;
        before = now;
    }
    return passing > 0 && passing < PASSING * bins->all && passes <= MAX_PASSES ? nearer : 0.0f;
}

/* Leave the marker's target only, if there are two or one that passes by. */
static struct rl_column select_target(const struct rl_sensor *sensor, const float *distance,
                                      int rows, struct rl_column held, bool is_dimmer,
                                      struct rl_room *room)
{
    struct bins bins = {.gap_m = (float)(sensor->separable_m - RL_UNSURE_M),
                        .steps_a_metre = (float)(FINE * BINS / sensor->max_distance_m)};
    float *signal = room->signal, middle = 0.0f;
    uint8_t *valid = room->valid;
    sort_into(&bins, distance, rows, 0.0f);
    const float nearer = passing_by(&bins, distance, rows);
    if (nearer > 0.0f) {
        sort_into(&bins, distance, rows, nearer);
    }
    const float widest = widest_gap(&bins, &middle);
    if (nearer <= 0.0f && widest < bins.gap_m) {
        return held;
    }
    memcpy(signal, held.signal, (size_t)rows * sizeof *signal);
    memcpy(valid, held.valid, (size_t)rows);
    double sum[2] = {0.0, 0.0}, seen[2] = {1e-9, 1e-9};
    for (int row = 0; row < rows; row++) {
        const float d = distance[row];
        if (isnan(d) || !valid[row]) {
            continue;
        }
        if (d < nearer) {
            valid[row] = 0;
            signal[row] = row > 0 ? signal[row - 1] : 0.0f;
            continue;
        }
        sum[d > middle] += (double)signal[row];
        seen[d > middle] += 1.0;
    }
    const struct rl_column changed = {signal, valid, widest >= bins.gap_m};
    if (!changed.has_two_targets) {
        return changed;
    }
    const int other = (sum[1] / seen[1] < sum[0] / seen[0]) != is_dimmer;
    const double own = sum[!other] / seen[!other];
    for (int row = 0; row < rows; row++) {
        const float d = distance[row];
        if (!isnan(d) && valid[row] && (d > middle) == other) {
            valid[row] = !is_dimmer || (double)signal[row] < own;
            signal[row] = 0.0f;
        }
    }
    return changed;
}

void rl_room_start(struct rl_room *room, int rows, struct rl_memory *memory)
{
    room->signal = rl_take(memory, rows, sizeof *room->signal);
    room->valid = rl_take(memory, rows, 1);
}

/* Largest less least of the measured distances. */
static float range_of(const float *distance, int rows)
{
    float least[RL_LANES], most[RL_LANES];
    for (int lane = 0; lane < RL_LANES; lane++) {
        least[lane] = INFINITY;
        most[lane] = -INFINITY;
    }
    for (int row = 0; row < rows; row++) {
        const int lane = row % RL_LANES;
        least[lane] = rl_minf(distance[row], least[lane]);
        most[lane] = rl_maxf(distance[row], most[lane]);
    }
    for (int lane = 1; lane < RL_LANES; lane++) {
        least[0] = rl_minf(least[lane], least[0]);
        most[0] = rl_maxf(most[lane], most[0]);
    }
    return most[0] - least[0];
}

struct rl_column rl_target_column(const struct rl_samples *samples, int channel, int first,
                                  int rows, bool is_dimmer, struct rl_room *room)
{
    const size_t at = rl_sample(samples, channel, first);
    const struct rl_column held = {samples->signal + at, samples->valid + at, false};
    if (channel >= samples->zones || samples->interference_removed[channel] ||
        !(range_of(samples->distance + at, rows) >
          (float)(samples->sensor.separable_m - RL_UNSURE_M))) {
        return held;
    }
    return select_target(&samples->sensor, samples->distance + at, rows, held, is_dimmer, room);
}
