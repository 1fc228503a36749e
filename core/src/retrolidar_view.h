/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Samples of some channels side by side, less the level that wanders, ready to be cut into bits. */
#ifndef RETROLIDAR_VIEW_H
#define RETROLIDAR_VIEW_H

#include "retrolidar_codebook.h"
#include "retrolidar_constants.h"
#include "retrolidar_target.h"

enum {
    RL_MAX_LANES = (RL_MAX_CHANNELS + RL_LANES - 1) / RL_LANES * RL_LANES,
    RL_MAX_PACKETS = 8,
    RL_MAX_EDGES = RL_PACKET_BITS * RL_MAX_PACKETS + 1,
};

/* A time within an exposure. */
struct rl_edge {
    int row;
    float share; /* of the exposure, 0 to 1 */
};

/* Arrays over rows and lanes; a lane is a channel. */
struct rl_view {
    const struct rl_samples *samples;
    int first, rows; /* in the samples */
    int lanes;       /* a multiple of RL_LANES */
    float *begin; /* of each exposure since the first, and after the last what never comes [s] */
    float *rate;  /* 1 over the length of each exposure [1/s] */
    float *light;
    float *total; /* sums of light over the rows before */
    float *power; /* sums of light times signal */
    float *valid; /* sums of valid samples */
    float *pivot; /* of the lanes that are whitened */
    struct rl_room room[RL_LANES];
    struct rl_edge edge[RL_MAX_EDGES]; /* of the bits of a trial */
};

/* What is tried: where bits begin and end. */
struct rl_trial {
    double end_s, bit_s;
    int packets;             /* back to back, to be laid on top of each other */
    uint32_t seen;           /* bits that ended after the window began */
    struct rl_energy energy; /* mean one of bits that are seen */
};

/* What the soft bits of a lane can be at the most. */
struct rl_soft_summary {
    uint32_t dark; /* those that are positive ... */
    float any;     /* ... and their sum */
    float squares; /* of all, their sum */
    float power;   /* of the samples in the window */
    float samples; /* valid ones */
};

/* What a trial makes of all lanes, which are in groups of RL_LANES. */
struct rl_sums {
    float soft[RL_MAX_LANES / RL_LANES][RL_PACKET_BITS][RL_LANES]; /* light, positive = dark */
    struct rl_soft_summary summary[RL_MAX_LANES];
};

void rl_view_start(struct rl_view *view, const struct rl_samples *samples,
                   struct rl_memory *memory);

/* Look at some channels from one time to another; walk: of steps of the level over the noise. */
void rl_view_open(struct rl_view *view, const int *channels, int count, double from_s, double to_s,
                  float walk);

/* Find where the bits of a trial begin and end, and their energies. */
void rl_view_place_bit_edges(struct rl_view *view, struct rl_trial *trial);

/* Cut a group of lanes into the bits of the trial that was laid last. */
void rl_view_integrate_and_dump(const struct rl_view *view, const struct rl_trial *trial, int group,
                                struct rl_sums *sums);

/* One step of the elimination: rows from the first on. */
void rl_lanes_eliminate(float stiff, float ends, const float *restrict known,
                        const float *restrict value, const float *restrict light_before,
                        const float *restrict pivot_before, float *restrict light,
                        float *restrict pivot);

/* One step of the substitution, rows from the last on: what the elimination has left becomes the
 * level, and the level what is left of the samples. Sums are of the rows from this one on,
 * negative.
 */
void rl_lanes_substitute(const float *restrict level_after, const float *restrict total_after,
                         const float *restrict power_after, const float *restrict valid_after,
                         float *restrict pivot, float *restrict light, float *restrict total,
                         float *restrict power, float *restrict valid);

/* Light of some lanes until an edge, and what a bit has lost since the edge before. */
void rl_lanes_integrate_and_dump(float share, const float *restrict total,
                                 const float *restrict light, const float *restrict before,
                                 float *restrict until, float *restrict soft);

void rl_lanes_summarise(const float *restrict soft, uint32_t bit, float *restrict any,
                        float *restrict squares, uint32_t *restrict dark);

#endif
