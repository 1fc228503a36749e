/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Where packets may be: every start, clock and word, on coarse templates. It decides nothing. */
#ifndef RETROLIDAR_SEARCH_H
#define RETROLIDAR_SEARCH_H

#include "retrolidar_codebook.h"
#include "retrolidar_constants.h"
#include "retrolidar_template.h"
#include "retrolidar_view.h"

enum {
    RL_HITS = 2 * RL_TRIED, /* of a search, and words that it looks for in a whole packet */
    /* Each word and sequence of a whole packet may be of another trial, and the next one, too.
     * Where a part is seen there are more words, but only of RL_TRIED trials.
     */
    RL_SLOTS = RL_HITS + RL_TRIED + 1,
};

/* A packet that may be there. */
struct rl_hit {
    float nats; /* about by how much it explains the samples better than noise does */
    uint16_t id;
    struct rl_transmission transmission; /* read from any bit, if it repeats */
};

/* A packet or sequence that the soft bits of a trial may hold. */
struct rl_shortlist_entry {
    float nats; /* that no packet exceeds by much, or that any sequence of bits reaches */
    int shift;  /* bit of the window with which the packet begins */
    int slot;   /* of the trial */
};

/* A trial, and what it makes of a lane. */
struct rl_slot {
    struct rl_trial trial;
    float soft[RL_PACKET_BITS];
    struct rl_soft_summary summary;
};

/* The best hits of different IDs; and the sequences that explain most, each of another clock. */
struct rl_hits {
    int reference; /* zone whose light was subtracted, or RL_NO_REFERENCE */
    int count, sequences;
    struct rl_hit hit[RL_HITS];
    struct rl_transmission sequence[RL_TRIED]; /* of a word or not */
};

/* What is to be looked at once all trials are known. Where only a part of a packet is seen, it may
 * begin with any bit: the preamble need not be among those that are.
 */
struct rl_shortlist {
    int words, sequences;
    struct rl_shortlist_entry word[RL_PACKET_BITS];
    struct rl_shortlist_entry sequence[RL_TRIED];
    struct rl_slot slot[RL_SLOTS];
};

/* What is asked of a hit. */
struct rl_demand {
    float least;             /* nats */
    float max_llr_deficit;   /* nats by which any sequence of bits may be better */
    bool repeats;            /* whether the window is any stretch of a packet that repeats */
    struct rl_energy energy; /* of the whitening */
    const struct rl_smooth *smooth;
};

/* About by how much any sequence of bits explains a trial better than noise does [nats]. */
float rl_llr_upper_bound(const struct rl_demand *demand, const struct rl_trial *trial,
                         const struct rl_soft_summary *summary);

/* Note what a lane may hold: sequences, and packets that begin with one of so many first bits. */
void rl_shortlist_add(struct rl_shortlist *shortlist, const struct rl_demand *demand,
                      const struct rl_trial *trial, const struct rl_sums *sums, int lane,
                      int shifts);

/* Give up the least promising words of some channels, as far as there are more than are left; take
 * the others off what is left, and return how many were given up.
 */
int rl_shortlists_ration(struct rl_shortlist *shortlist, int channels, int *left);

/* Search the words of a shortlist, and find the best sequences of bits if there is one. */
void rl_hits_find(struct rl_hits *hits, const struct rl_shortlist *shortlist,
                  const struct rl_codebook *codebook, const struct rl_demand *demand);

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
