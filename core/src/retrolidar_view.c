/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_view.h"

#include <math.h>
#include <string.h>

/* Lanes for so many channels. */
static int lanes_of(int channels)
{
    return (channels + RL_LANES - 1) / RL_LANES * RL_LANES;
}

void rl_view_start(struct rl_view *view, const struct rl_samples *samples,
                   struct rl_memory *memory)
{
    const int64_t rows = samples->kept + 1;
    const int lanes = lanes_of(samples->channels);
    view->samples = samples;
    view->light = rl_take(memory, lanes * rows, sizeof(float));
    view->total = rl_take(memory, lanes * rows, sizeof(float));
    view->power = rl_take(memory, lanes * rows, sizeof(float));
    view->valid = rl_take(memory, lanes * rows, sizeof(float));
    view->pivot = rl_take(memory, RL_LANES * rows, sizeof(float));
    view->begin = rl_take(memory, rows, sizeof(float));
    view->rate = rl_take(memory, rows, sizeof(float));
    for (int lane = 0; lane < RL_LANES; lane++) {
        rl_room_start(&view->room[lane], samples->kept, memory);
    }
}

static float mean_of(const float *signal, int rows)
{
    float sum[RL_LANES] = {0.0f};
    int row = 0;
    for (; row + RL_LANES <= rows; row += RL_LANES) {
        for (int lane = 0; lane < RL_LANES; lane++) {
            sum[lane] += signal[row + lane];
        }
    }
    for (; row < rows; row++) {
        sum[0] += signal[row];
    }
    for (int lane = 1; lane < RL_LANES; lane++) {
        sum[0] += sum[lane];
    }
    return sum[0] / (float)rows;
}

/* Subtract the level l from the samples x of RL_LANES lanes, from `lane` on. l minimises the sum of
 * (x - l)^2 and of the squared steps of l over `walk`: a tridiagonal system.
 */
static void whiten(struct rl_view *view, const struct rl_column *column, size_t lane, float walk)
{
    static const float NOTHING[RL_LANES] = {0.0f};
    const size_t rows = (size_t)view->rows, lanes = (size_t)view->lanes;
    const float stiff = 1.0f / walk;
    float mean[RL_LANES];
    for (int i = 0; i < RL_LANES; i++) {
        mean[i] = mean_of(column[i].signal, view->rows);
    }
    /* The memory of the sums holds values and validity first. */
    float *value = view->power + lane, *known = view->valid + lane, *light = view->light + lane;
    float *pivot = view->pivot, *total = view->total + lane;
    for (size_t row = 0; row < rows; row++) {
        const size_t at = row * lanes;
        const float ends = (row > 0 ? stiff : 0.0f) + (row + 1 < rows ? stiff : 0.0f);
        for (int i = 0; i < RL_LANES; i++) {
            value[at + (size_t)i] = column[i].signal[row] - mean[i];
            known[at + (size_t)i] = column[i].valid[row];
        }
        rl_lanes_eliminate(
            stiff, ends, known + at, value + at, row > 0 ? light + at - lanes : NOTHING,
            row > 0 ? pivot + (row - 1) * RL_LANES : NOTHING, light + at, pivot + row * RL_LANES);
    }
    memset(total + rows * lanes, 0, RL_LANES * sizeof *total);
    memset(value + rows * lanes, 0, RL_LANES * sizeof *value);
    memset(known + rows * lanes, 0, RL_LANES * sizeof *known);
    memset(light + rows * lanes, 0, RL_LANES * sizeof *light);
    memset(pivot + rows * RL_LANES, 0, RL_LANES * sizeof *pivot);
    for (size_t row = rows; row-- > 0;) {
        const size_t at = row * lanes, after = at + lanes;
        rl_lanes_substitute(pivot + (row + 1) * RL_LANES, total + after, value + after,
                            known + after, pivot + row * RL_LANES, light + at, total + at,
                            value + at, known + at);
    }
}

void rl_view_open(struct rl_view *view, const int *channels, int count, double from_s, double to_s,
                  float walk)
{
    const struct rl_samples *samples = view->samples;
    const int end = rl_samples_row(samples, to_s - 1e-9) + 1;
    const int last = end < samples->count ? end : samples->count;
    const int first = rl_samples_row(samples, from_s);
    view->first = last - first < samples->kept ? first : last - samples->kept;
    view->rows = last - view->first;
    view->lanes = lanes_of(count);
    for (int row = 0; row < view->rows; row++) {
        const double begin_s = samples->begin_s[view->first + row];
        view->begin[row] = (float)(begin_s - samples->begin_s[view->first]);
        view->rate[row] = (float)(1.0 / (samples->end_s[view->first + row] - begin_s));
    }
    view->begin[view->rows] = INFINITY;
    for (int lane = 0; lane < view->lanes; lane += RL_LANES) {
        struct rl_column column[RL_LANES];
        for (int i = 0; i < RL_LANES; i++) {
            const int channel = channels[lane + i < count ? lane + i : count - 1];
            column[i] = rl_target_column(samples, channel, view->first, view->rows, false,
                                         &view->room[i]);
        }
        whiten(view, column, (size_t)lane, walk);
    }
}

void rl_view_place_bit_edges(struct rl_view *view, struct rl_trial *trial)
{
    const int bits = RL_PACKET_BITS * trial->packets;
    const float bit_s = (float)trial->bit_s;
    const float first_s =
        (float)(trial->end_s - bits * trial->bit_s - view->samples->begin_s[view->first]);
    float shared = 0.0f;
    int row = 0, seen = bits;
    while (seen > 0 && first_s + (float)(bits - seen + 1) * bit_s <= 0.0f) {
        seen--;
    }
    trial->seen = seen < RL_PACKET_BITS ? RL_ALL_BITS >> (RL_PACKET_BITS - seen) : RL_ALL_BITS;
    for (int bit = 0; bit <= bits; bit++) {
        const float time_s = first_s + (float)bit * bit_s;
        while (view->begin[row + 1] <= time_s) {
            row++;
        }
        const float passed = (time_s - view->begin[row]) * view->rate[row];
        const float share = rl_minf(rl_maxf(passed, 0.0f), 1.0f);
        view->edge[bit] = (struct rl_edge){row, share};
        shared += share * (1.0f - share);
    }
    /* A bit has an energy of 1 per exposure, less what it shares with the bits beside it. */
    const struct rl_edge *first = &view->edge[0], *last = &view->edge[bits];
    const float exposures = (float)(last->row - first->row) + last->share - first->share;
    const float outside = first->share * (1.0f - first->share);
    const float ended = last->share * (1.0f - last->share);
    trial->energy.own = (exposures - 2.0f * shared + outside + ended) / rl_maxf((float)seen, 1.0f);
    trial->energy.adjacent = (shared - outside) / rl_maxf((float)seen, 1.0f);
}

/* Power and number of the valid samples of a lane; erasures reduce the power by their share. */
static struct rl_soft_summary summary_of(const struct rl_view *view, const struct rl_trial *trial,
                                         int lane)
{
    const size_t lanes = (size_t)view->lanes;
    const int from = view->edge[0].row;
    const int to = view->edge[RL_PACKET_BITS * trial->packets].row + 1;
    const size_t last = (size_t)to * lanes + (size_t)lane;
    const size_t first = (size_t)from * lanes + (size_t)lane;
    const float samples = view->valid[last] - view->valid[first];
    const float power = (view->power[last] - view->power[first]) * samples / (float)(to - from);
    return (struct rl_soft_summary){.power = rl_maxf(power, 1e-6f), .samples = samples};
}

void rl_view_integrate_and_dump(const struct rl_view *view, const struct rl_trial *trial, int group,
                                struct rl_sums *sums)
{
    const size_t lanes = (size_t)view->lanes, lane = (size_t)group * RL_LANES;
    const int bits = RL_PACKET_BITS * trial->packets;
    float(*soft)[RL_LANES] = sums->soft[group];
    float until[2][RL_LANES] = {{0.0f}}, unused[RL_LANES] = {0.0f};
    memset(soft, 0, sizeof sums->soft[group]);
    for (int edge = 0, bit = 0; edge <= bits; edge++) {
        const size_t at = (size_t)view->edge[edge].row * lanes + lane;
        rl_lanes_integrate_and_dump(view->edge[edge].share, view->total + at, view->light + at,
                                    until[(edge + 1) % 2], until[edge % 2],
                                    edge > 0 ? soft[bit] : unused);
        bit = edge == 0 || bit + 1 == RL_PACKET_BITS ? 0 : bit + 1;
    }
    float any[RL_LANES] = {0.0f}, squares[RL_LANES] = {0.0f};
    uint32_t dark[RL_LANES] = {0};
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        rl_lanes_summarise(soft[bit], rl_packet_bit(bit), any, squares, dark);
    }
    for (int i = 0; i < RL_LANES; i++) {
        struct rl_soft_summary *one = &sums->summary[lane + (size_t)i];
        *one = summary_of(view, trial, (int)lane + i);
        one->dark = dark[i];
        one->any = any[i];
        one->squares = squares[i];
    }
}
