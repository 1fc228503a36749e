/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Search for candidates: packets of every start, clock and word, on coarse templates. */
#ifndef RETROLIDAR_SEARCH_H
#define RETROLIDAR_SEARCH_H

#include "retrolidar_codebook.h"
#include "retrolidar_constants.h"
#include "retrolidar_template.h"
#include "retrolidar_view.h"

enum { RL_HITS = 2 * RL_TRIED }; /* of a search, and its shortlist entries of whole packets */

/* A packet that may be there. */
struct rl_hit {
    float nats; /* approximate log likelihood ratio against noise */
    uint16_t id;
    struct rl_transmission transmission;
};

/* A packet or sequence that the soft bits of a trial in one lane may hold. */
struct rl_shortlist_entry {
    float nats; /* bound of the packets that begin there, or of any sequence of bits */
    int shift;  /* bit of the window with which the packet begins */
    struct rl_trial trial;
    float soft[RL_PACKET_BITS];
    struct rl_soft_summary summary;
};

/* The best hit of each ID, and the best sequence of bits of each clock. */
struct rl_hits {
    int count, sequences;
    struct rl_hit hit[RL_HITS];
    struct rl_transmission sequence[RL_TRIED]; /* of any bits, a word or not */
};

/* The best entries of all trials in one lane, to be compared with all words. If only a part of a
 * packet is seen, it may begin with any bit: the preamble may not be in that part.
 */
struct rl_shortlist {
    int words, sequences;
    struct rl_shortlist_entry word[RL_PACKET_BITS];
    struct rl_shortlist_entry sequence[RL_TRIED];
};

/* What a hit must fulfil. */
struct rl_criteria {
    float least;             /* nats */
    float max_llr_deficit;   /* nats by which any sequence of bits may be better */
    bool repeats;            /* whether the window is any stretch of a repeating packet */
    const struct rl_smooth *smooth;
};

/* Approximate log likelihood ratio of the best sequence of bits of a trial against noise [nats]. */
float rl_llr_upper_bound(const struct rl_criteria *criteria, const struct rl_trial *trial,
                         const struct rl_soft_summary *summary);

/* Add a trial to a lane's shortlist, for packets that begin with one of the first `shifts` bits. */
void rl_shortlist_add(struct rl_shortlist *shortlist, const struct rl_criteria *criteria,
                      const struct rl_trial *trial, const struct rl_sums *sums, int lane,
                      int shifts);

/* Drop the worst entries of some shortlists if there are more than `left`; subtract the others from
 * `left`. Return how many were dropped.
 */
int rl_shortlists_ration(struct rl_shortlist *shortlist, int channels, int *left);

/* Search the words of a shortlist, and find the best sequences of bits if there is one. */
void rl_hits_find(struct rl_hits *hits, const struct rl_shortlist *shortlist,
                  const struct rl_codebook *codebook, const struct rl_criteria *criteria);

/* A channel is strong if its variance over that of its noise is greater. */
static const double RL_STRONG = 4.0;

/* How samples are whitened before they are searched. */
struct rl_whitening {
    float walk; /* variance of the level's steps over that of the noise */
    struct rl_smooth smooth;
};

struct rl_search {
    struct rl_codebook codebook;
    struct rl_whitening whitening[3]; /* for faint and strong channels, and faint lone packets */
    double frames_a_bit;              /* for which the whitening was planned */
    struct rl_view view;
    struct rl_sums sums;
    struct rl_shortlist shortlist[RL_MAX_CHANNELS];
    int words_left; /* shortlist entries that this frame may still compare with all words */
    bool dropped;   /* whether there were more */
};

void rl_search_start(struct rl_search *search, const struct rl_samples *samples,
                     struct rl_memory *memory);

/* What is searched for. */
struct rl_sought {
    /* 0 = a packet that ended within (from_s, to_s], otherwise any stretch of so many packets that
     * repeat, which ends at to_s.
     */
    int packets;
    double from_s, to_s;
    double since_s; /* earlier samples are left out, as the marker was not there yet */
    double least;   /* nats that a hit must have */
    double max_llr_deficit; /* nats by which any sequence of bits may be better */
};

/* Find packets in some channels. */
void rl_search_channels(struct rl_search *search, const struct rl_sought *sought,
                        const int *channels, int count, struct rl_hits *hits);

#endif
