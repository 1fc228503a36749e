/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_view.h"

#include "retrolidar_math.h"
#include "retrolidar_target.h"

#include <string.h>

/* Weight of an erasure on the level: next to none, but enough to divide by. */
static const float ERASED = 1e-3f;

/* A time within an exposure. */
struct edge {
    int row;
    float share; /* of the exposure, 0 to 1 */
};

int64_t rl_view_bytes(int rows)
{
    return (int64_t)(rows + 1) * ((4 * RL_MOST_SOURCES + 4) * (int64_t)sizeof(float) + 1);
}

void rl_view_start(struct rl_view *view, const struct rl_samples *samples, void *memory)
{
    const size_t rows = (size_t)samples->kept + 1;
    view->samples = samples;
    view->light = memory;
    view->total = view->light + rows * RL_MOST_SOURCES;
    view->power = view->total + rows * RL_MOST_SOURCES;
    view->valid = view->power + rows * RL_MOST_SOURCES;
    view->signal = view->valid + rows * RL_MOST_SOURCES;
    view->scratch = view->signal + rows;
    view->begin = view->scratch + rows;
    view->rate = view->begin + rows;
    view->known = (uint8_t *)(view->rate + rows);
}

/* Take the level off the samples of a lane: z = x - l, where l is the smoothest of all levels,
 * the sum of squares of z and of steps of l over `walk` being least. It solves a tridiagonal
 * system.
 */
static void whiten_lane(struct rl_view *view, int source, int lane, float walk)
{
    const int rows = view->rows;
    const size_t lanes = (size_t)view->lanes;
    float *signal = view->signal, *pivot = view->scratch, *light = view->light + lane;
    rl_target_column(view->samples, source, view->first, rows, signal, view->known, pivot);
    float mean = 0.0f;
    for (int row = 0; row < rows; row++) {
        mean += signal[row];
    }
    mean /= (float)rows;
    const float stiff = 1.0f / walk;
    float before = 0.0f, pivot_before = 0.0f;
    for (int row = 0; row < rows; row++) {
        const float weight = view->known[row] ? 1.0f : ERASED;
        const float ends = (row > 0 ? stiff : 0.0f) + (row + 1 < rows ? stiff : 0.0f);
        pivot_before = 1.0f / (weight + ends - stiff * stiff * pivot_before);
        before = (weight * (signal[row] - mean) + stiff * before) * pivot_before;
        pivot[row] = stiff * pivot_before;
        light[(size_t)row * lanes] = before;
    }
    for (int row = rows - 2; row >= 0; row--) {
        light[(size_t)row * lanes] += pivot[row] * light[(size_t)(row + 1) * lanes];
    }
    float total = 0.0f, power = 0.0f, valid = 0.0f;
    for (int row = 0; row <= rows; row++) {
        const size_t at = (size_t)row * lanes;
        view->total[at + (size_t)lane] = total;
        view->power[at + (size_t)lane] = power;
        view->valid[at + (size_t)lane] = valid;
        if (row < rows) {
            const float value = signal[row] - mean;
            const float z = view->known[row] ? value - light[at] : 0.0f;
            light[at] = z;
            total += z;
            power += z * value;
            valid += view->known[row] ? 1.0f : 0.0f;
        }
    }
}

void rl_view_open(struct rl_view *view, const int *sources, int count, double from_s, double to_s,
                  float walk)
{
    const struct rl_samples *samples = view->samples;
    const int end = rl_samples_row(samples, to_s - 1e-9) + 1;
    view->first = rl_samples_row(samples, from_s);
    view->rows = (end < samples->count ? end : samples->count) - view->first;
    view->rows = view->rows < samples->kept ? view->rows : samples->kept;
    view->lanes = (count + RL_LANES - 1) / RL_LANES * RL_LANES;
    for (int row = 0; row < view->rows; row++) {
        const double begin_s = samples->begin_s[view->first + row];
        view->begin[row] = (float)(begin_s - samples->begin_s[view->first]);
        view->rate[row] = (float)(1.0 / (samples->end_s[view->first + row] - begin_s));
    }
    for (int lane = 0; lane < view->lanes; lane++) {
        whiten_lane(view, sources[lane < count ? lane : count - 1], lane, walk);
    }
}

static void find_edges(const struct rl_view *view, struct rl_trial *trial, struct edge *edges)
{
    const int bits = RL_PACKET_BITS * trial->packets;
    const float bit_s = (float)trial->bit_s;
    const float first_s =
        (float)(trial->end_s - bits * trial->bit_s - view->samples->begin_s[view->first]);
    float own = 0.0f, adjacent = 0.0f, share_before = 0.0f;
    int row = (int)(first_s / (float)view->samples->period_s) - 1;
    row = row < 0 ? 0 : row < view->rows ? row : view->rows - 1;
    while (row > 0 && view->begin[row] > first_s) {
        row--;
    }
    for (int bit = 0, row_before = row; bit <= bits; bit++) {
        const float time_s = first_s + (float)bit * bit_s;
        while (row + 1 < view->rows && view->begin[row + 1] <= time_s) {
            row++;
        }
        const float passed = (time_s - view->begin[row]) * view->rate[row];
        const float share = rl_minf(rl_maxf(passed, 0.0f), 1.0f);
        edges[bit] = (struct edge){row, share};
        if (bit > 0 && row == row_before) {
            own += (share - share_before) * (share - share_before);
        } else if (bit > 0) {
            own += (1.0f - share_before) * (1.0f - share_before) + (float)(row - row_before - 1) +
                   share * share;
        }
        adjacent += bit > 0 ? share * (1.0f - share) : 0.0f;
        share_before = share;
        row_before = row;
    }
    trial->own = own / (float)bits;
    trial->adjacent = adjacent / (float)bits;
}

/* Bits of which samples are missing have so much less energy. */
static float present(float power, float samples, int rows)
{
    return rl_maxf(power * samples / (float)rows, 1e-6f);
}

void rl_view_cut(const struct rl_view *view, struct rl_trial *trial, struct rl_sums *sums)
{
    struct edge edges[RL_MOST_EDGES];
    float before[RL_MOST_SOURCES];
    const size_t lanes = (size_t)view->lanes;
    const int bits = RL_PACKET_BITS * trial->packets;
    find_edges(view, trial, edges);
    memset(sums->soft, 0, RL_PACKET_BITS * lanes * sizeof *sums->soft);
    for (int edge = 0, bit = 0; edge <= bits; edge++) {
        const float *light = view->light + (size_t)edges[edge].row * lanes;
        const float *total = view->total + (size_t)edges[edge].row * lanes;
        const float share = edges[edge].share;
        float *soft = sums->soft + (size_t)bit * lanes;
        for (size_t lane = 0; lane < lanes; lane++) {
            const float until = total[lane] + share * light[lane];
            soft[lane] += edge > 0 ? before[lane] - until : 0.0f;
            before[lane] = until;
        }
        bit = edge == 0 || bit + 1 == RL_PACKET_BITS ? 0 : bit + 1;
    }
    const int from = edges[0].row, to = edges[bits].row + 1;
    for (int lane = 0; lane < view->lanes; lane++) {
        const size_t last = (size_t)to * lanes + (size_t)lane;
        const size_t first = (size_t)from * lanes + (size_t)lane;
        sums->samples[lane] = view->valid[last] - view->valid[first];
        sums->power[lane] =
            present(view->power[last] - view->power[first], sums->samples[lane], to - from);
    }
}

void rl_view_cut_lane(const struct rl_view *view, struct rl_trial *trial, int lane,
                      struct rl_lane *sums)
{
    struct edge edges[RL_MOST_EDGES];
    const size_t lanes = (size_t)view->lanes, column = (size_t)lane;
    const int bits = RL_PACKET_BITS * trial->packets;
    float before = 0.0f;
    find_edges(view, trial, edges);
    memset(sums->soft, 0, sizeof sums->soft);
    for (int edge = 0; edge <= bits; edge++) {
        const size_t at = (size_t)edges[edge].row * lanes + column;
        const float until = view->total[at] + edges[edge].share * view->light[at];
        if (edge > 0) {
            sums->soft[(edge - 1) % RL_PACKET_BITS] += before - until;
        }
        before = until;
    }
    const int from = edges[0].row, to = edges[bits].row + 1;
    const size_t last = (size_t)to * lanes + column, first = (size_t)from * lanes + column;
    sums->samples = view->valid[last] - view->valid[first];
    sums->power = present(view->power[last] - view->power[first], sums->samples, to - from);
}

void rl_lane_of(const struct rl_view *view, const struct rl_sums *sums, int lane,
                struct rl_lane *one)
{
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        one->soft[bit] = sums->soft[(size_t)bit * (size_t)view->lanes + (size_t)lane];
    }
    one->power = sums->power[lane];
    one->samples = sums->samples[lane];
}
