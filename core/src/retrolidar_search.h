/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Where packets may be: every start, clock and word, on coarse templates. It prunes, and decides
 * nothing.
 */
#ifndef RETROLIDAR_SEARCH_H
#define RETROLIDAR_SEARCH_H

#include "retrolidar_hits.h"

/* Variance of a channel, in that of its noise, from which it is strong. */
static const double RL_STRONG = 4.0;

/* How samples are whitened before they are searched. */
struct rl_whitening {
    float walk; /* variance of the level's steps over that of the noise */
    struct rl_energy energy;
    struct rl_smooth smooth;
};

struct rl_search {
    const struct rl_samples *samples;
    struct rl_codebook codebook;
    struct rl_whitening whitening[3]; /* for faint and strong channels, and faint lone packets */
    double frames_a_bit;              /* that the whitening is for */
    double least;                     /* nats that a hit must have */
    struct rl_view view;
    struct rl_sums sums;
    struct rl_shortlist shortlist[RL_MAX_CHANNELS];
    int words_left; /* soft bits that may still be held against all words with this frame */
    bool dropped;   /* whether there were more */
};

void rl_search_start(struct rl_search *search, const struct rl_samples *samples,
                     struct rl_memory *memory);

/* Find packets in some channels.
 *
 * packets: 0 = a packet that ended within (from_s, to_s], otherwise any stretch of so many packets
 *     that repeat, which ends at to_s
 * since_s: earlier samples are left out: what is sought was not there
 * max_llr_deficit: nats by which any sequence of bits may be better
 */
void rl_search_look(struct rl_search *search, const int *channels, int count, int packets,
                    double from_s, double to_s, double since_s, double max_llr_deficit,
                    struct rl_hits *hits);

#endif
