/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Samples of some channels, without their wandering level, to be integrated over bits. */
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

/* Arrays over rows and lanes. A lane is a channel; RL_LANES of them are computed at once. */
struct rl_view {
    const struct rl_samples *samples;
    int first, rows; /* in the samples */
    int lanes;       /* a multiple of RL_LANES */
    float *begin; /* of each exposure since the first, and INFINITY after the last [s] */
    float *rate;  /* 1 over the length of each exposure [1/s] */
    float *light; /* each sample less the level */
    float *total; /* sums of light over this row and those after it, negative ... */
    float *power; /* ... of light times signal ... */
    float *valid; /* ... and of valid samples */
    float *pivot; /* of the lanes that are whitened */
    struct rl_room room[RL_LANES];
    struct rl_edge edge[RL_MAX_EDGES]; /* of the bits of a trial */
};

/* A hypothesis of the time of a packet: its end, bit period and number of repetitions. */
struct rl_trial {
    double end_s, bit_s;
    int packets;             /* back to back, whose soft bits are added */
    uint32_t seen;           /* bits that ended after the window began */
    struct rl_energy energy; /* mean of the bits that are seen */
};

/* Sums over the soft bits and samples of a lane, which bound any packet's likelihood. */
struct rl_soft_summary {
    uint32_t dark; /* mask of the positive soft bits ... */
    float any;     /* ... and their sum */
    float squares; /* sum of the squares of all soft bits */
    float power;   /* of the samples in the window */
    float samples; /* valid ones */
};

/* Soft bits of a trial in all lanes, in groups of RL_LANES. */
struct rl_sums {
    float soft[RL_MAX_LANES / RL_LANES][RL_PACKET_BITS][RL_LANES]; /* light, positive = dark */
    struct rl_soft_summary summary[RL_MAX_LANES];
};

void rl_view_start(struct rl_view *view, const struct rl_samples *samples,
                   struct rl_memory *memory);

/* Whiten some channels from one time to another; walk: variance of the level's steps over noise. */
void rl_view_open(struct rl_view *view, const int *channels, int count, double from_s, double to_s,
                  float walk);

/* Find where the bits of a trial begin and end, and their energies. */
void rl_view_place_bit_edges(struct rl_view *view, struct rl_trial *trial);

/* Integrate a group of lanes over each bit of the trial whose edges were placed last. */
void rl_view_integrate_and_dump(const struct rl_view *view, const struct rl_trial *trial, int group,
                                struct rl_sums *sums);

/* One row of the forward elimination, from the first row on. */
void rl_lanes_eliminate(float stiff, float ends, const float *restrict known,
                        const float *restrict value, const float *restrict light_before,
                        const float *restrict pivot_before, float *restrict light,
                        float *restrict pivot);

/* One row of the back substitution, from the last row on. `pivot` becomes the level, and `light`
 * the sample less the level. The sums are negative, over the rows from this one on.
 */
void rl_lanes_substitute(const float *restrict level_after, const float *restrict total_after,
                         const float *restrict power_after, const float *restrict valid_after,
                         float *restrict pivot, float *restrict light, float *restrict total,
                         float *restrict power, float *restrict valid);

/* Integrate the light until an edge; add what is missing since the edge before to a soft bit. */
void rl_lanes_integrate_and_dump(float share, const float *restrict total,
                                 const float *restrict light, const float *restrict before,
                                 float *restrict until, float *restrict soft);

void rl_lanes_summarise(const float *restrict soft, uint32_t bit, float *restrict any,
                        float *restrict squares, uint32_t *restrict dark);

#endif
