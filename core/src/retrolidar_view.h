/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Samples of some sources side by side, less the level that wanders, ready to be cut into bits. */
#ifndef RETROLIDAR_VIEW_H
#define RETROLIDAR_VIEW_H

#include "retrolidar_codebook.h"
#include "retrolidar_samples.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { RL_MOST_PACKETS = 8, RL_MOST_EDGES = RL_PACKET_BITS * RL_MOST_PACKETS + 1 };

/* Arrays over rows and lanes; a lane is a source. */
struct rl_view {
    const struct rl_samples *samples;
    int first, rows; /* in the samples */
    int lanes;       /* columns, a multiple of RL_LANES */
    float *begin, *rate; /* of each exposure: since the first [s], and 1 over its length [1/s] */
    float *light;
    float *total; /* sums of light over the rows before */
    float *power; /* sums of light times signal */
    float *valid; /* sums of valid samples */
    float *signal, *scratch; /* of one column */
    uint8_t *known;
};

/* What is tried: where bits begin and end. */
struct rl_trial {
    double end_s, bit_s;
    int packets; /* back to back, to be laid on top of each other */
    float own, adjacent; /* energy of a bit, and of two side by side (`rl_energy`) */
};

/* What a trial makes of all lanes. */
struct rl_sums {
    float soft[RL_PACKET_BITS * RL_MOST_SOURCES]; /* light of each bit and lane, positive = dark */
    float power[RL_MOST_SOURCES];   /* of the samples in the window */
    float samples[RL_MOST_SOURCES]; /* valid ones */
};

/* What a trial makes of one lane. */
struct rl_lane {
    float soft[RL_PACKET_BITS];
    float power, samples;
};

int64_t rl_view_bytes(int rows);
void rl_view_start(struct rl_view *view, const struct rl_samples *samples, void *memory);

/* Look at some sources from one time to another, whitened for steps of the level whose variance is
 * `walk` of that of the noise.
 */
void rl_view_open(struct rl_view *view, const int *sources, int count, double from_s, double to_s,
                  float walk);

/* Cut all lanes, or one, into the bits of a trial, whose energies are set. */
void rl_view_cut(const struct rl_view *view, struct rl_trial *trial, struct rl_sums *sums);
void rl_view_cut_lane(const struct rl_view *view, struct rl_trial *trial, int lane,
                      struct rl_lane *sums);

/* The same of one lane, of those of all. */
void rl_lane_of(const struct rl_view *view, const struct rl_sums *sums, int lane,
                struct rl_lane *one);

#ifdef __cplusplus
}
#endif

#endif
