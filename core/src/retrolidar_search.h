/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Where packets may be: every start, clock and word, on coarse templates. It prunes, and decides
 * nothing.
 */
#ifndef RETROLIDAR_SEARCH_H
#define RETROLIDAR_SEARCH_H

#include "retrolidar_codebook.h"
#include "retrolidar_samples.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { RL_HITS = 6, RL_SEQUENCES = 3, RL_MOST_PACKETS = 8 };

/* A packet that may be there. */
struct rl_hit {
    float nats; /* about by how much it explains the samples better than noise does */
    uint16_t id;
    bool repeats; /* read from any bit of a packet that repeats */
    double start_s, bit_s;
};

/* A sequence of 31 bits, of a packet or not. */
struct rl_sequence {
    float nats;
    uint32_t bits;
    bool repeats;
    double start_s, bit_s;
    float soft[RL_BITS]; /* the bits before any decision, and their energy */
    struct rl_energy energy;
};

/* The best hits of different IDs in one source, the best first; and the sequences that explain the
 * samples best, each of another clock.
 */
struct rl_hits {
    int count, sequences;
    struct rl_hit hit[RL_HITS];
    struct rl_sequence sequence[RL_SEQUENCES];
};

/* Samples of some sources side by side, less the level that wanders. */
struct rl_view {
    int first, rows;
    float (*light)[RL_LANES]; /* of each row */
    float (*total)[RL_LANES]; /* sums of the rows before */
    float (*power)[RL_LANES]; /* sums of light times signal */
    float (*valid)[RL_LANES]; /* sums of valid samples */
    float *signal;            /* scratch of one column */
    float *scratch;
    uint8_t *known;
};

/* How samples are whitened before they are searched. */
struct rl_whitening {
    float walk; /* variance of the level's steps over that of the noise */
    struct rl_energy energy;
    float smooth[RL_MOST_WORDS];
};

struct rl_search {
    const struct rl_samples *samples;
    struct rl_codebook codebook;
    struct rl_whitening whitening[2]; /* for faint and for strong sources */
    double frames_a_bit; /* that the whitening is for */
    double bit_s;        /* as expected [s] */
    double most_skew;    /* by how much a clock may be off */
    struct rl_view view;
    int words_left; /* that may still be searched with this frame */
};

/* How much memory a search takes besides, and begin with it. */
int64_t rl_search_bytes(int rows);
void rl_search_start(struct rl_search *search, const struct rl_samples *samples, int rows,
                     double bit_s, void *memory);

/* Find packets in up to RL_LANES sources.
 *
 * packets: 0 = a packet that ended within (from_s, to_s], otherwise any stretch of so many packets
 *     that repeat, which ends at to_s
 * least: nats that a hit must have
 * most_beyond: nats by which any sequence of bits may be better
 */
void rl_search_look(struct rl_search *search, const int *sources, int count, int packets,
                    double from_s, double to_s, double least, double most_beyond,
                    struct rl_hits *hits);

#ifdef __cplusplus
}
#endif

#endif
