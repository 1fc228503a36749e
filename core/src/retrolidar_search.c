/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_search.h"

#include <math.h>

enum { EIGHTHS = 2 * RL_PHASES }; /* ends of packets that are tried in each bit */

/* In strong channels a hit needs so much more, as most of them are rejected later. */
static const double STRONG_SHARE = 1.3;
/* A smaller walk remembers the silence before a faint packet longer: its level is more certain. */
static const float WALKS[] = {0.01f, 0.1f, 0.002f};
enum { WALK_COUNT = 3, FAINT_LONE = 2 };

/* A stretch of a lane. */
struct stretch {
    float share; /* energy of its soft bits, over that of the samples */
    struct rl_trial trial;
    struct rl_soft_summary summary;
};

/* The stretches of a lane with the greatest shares. */
struct kept {
    int count;
    struct stretch stretch[RL_TRIED];
};

void rl_search_start(struct rl_search *search, const struct rl_samples *samples,
                     struct rl_memory *memory)
{
    rl_view_start(&search->view, samples, memory);
}

/* Find the energy that whitening removes from pairs of bits by their lag: the level's kernel, a
 * two-sided exponential, under two boxes of a bit each.
 */
static void plan(struct rl_search *search)
{
    enum { FINE = 16 };
    const double frames = search->view.samples->bit_s / search->view.samples->period_s;
    if (fabs(frames - search->frames_a_bit) < 0.02 * frames) {
        return;
    }
    search->frames_a_bit = frames;
    for (int which = 0; which < WALK_COUNT; which++) {
        struct rl_whitening *whitening = &search->whitening[which];
        const double q = (double)WALKS[which];
        const double memory = 1.0 + q / 2 - sqrt(q + q * q / 4);
        const double height = (1.0 - memory) / (1.0 + memory);
        double alone = 0.0, pair = 0.0;
        for (int i = 0; i < FINE; i++) {
            for (int j = 0; j < FINE; j++) {
                const double apart = (double)(i - j) / FINE;
                alone += pow(memory, fabs(apart) * frames);
                pair += pow(memory, (1.0 + apart) * frames);
            }
        }
        const double scale = height * frames * frames / (FINE * FINE);
        whitening->walk = WALKS[which];
        const struct rl_energy energy = {.own = rl_maxf((float)frames - 0.5f, 0.25f),
                                         .adjacent = 0.125f,
                                         .smooth = (float)(scale * alone),
                                         .pair = (float)(2.0 * scale * pair),
                                         .decay = (float)pow(memory, frames)};
        rl_codebook_smooth(&search->codebook, &energy, &whitening->smooth);
    }
}

static void integrate_all(struct rl_search *search, const struct rl_trial *trial)
{
    for (int group = 0; group < search->view.lanes / RL_LANES; group++) {
        rl_view_integrate_and_dump(&search->view, trial, group, &search->sums);
    }
}

/* Try packets that end at one time, at all clocks; or rivals only: any bits, in lanes with words.
 */
static void try_ends(struct rl_search *search, int count, double end_s, bool rivals,
                     const struct rl_criteria *criteria)
{
    /* The ends of a packet differ by a phase from one clock to the next. */
    const int clocks = (int)(RL_MAX_SKEW * RL_PACKET_BITS / 2 * RL_PHASES + 0.999);
    struct rl_trial trial = {.end_s = end_s, .packets = 1};
    for (int clock = -clocks; clock <= clocks; clock++) {
        trial.bit_s = search->view.samples->bit_s * (1.0 + clock * RL_MAX_SKEW / clocks);
        rl_view_place_bit_edges(&search->view, &trial);
        integrate_all(search, &trial);
        for (int lane = 0; lane < count; lane++) {
            if (!rivals || search->shortlist[lane].words > 0) {
                rl_shortlist_add(&search->shortlist[lane], criteria, &trial, &search->sums, lane,
                                 rivals ? 0 : 1);
            }
        }
    }
}

static void search_ended(struct rl_search *search, int count, double from_s, double to_s,
                         const struct rl_criteria *criteria)
{
    const double eighth_s = search->view.samples->bit_s / EIGHTHS;
    const double newest = floor(to_s / eighth_s);
    int back = 0;
    for (; (newest - back) * eighth_s > from_s; back++) {
        try_ends(search, count, (newest - back) * eighth_s, false, criteria);
    }
    bool promising = false;
    for (int lane = 0; lane < count; lane++) {
        promising = promising || search->shortlist[lane].words > 0;
    }
    if (!promising) {
        return;
    }
    /* Rivals of these: sequences of bits at any phase. */
    for (; back < EIGHTHS; back++) {
        try_ends(search, count, (newest - back) * eighth_s, true, criteria);
    }
}

/* Try all starts of a stretch. */
static void try_starts(struct rl_search *search, int lane, const struct stretch *stretch,
                       const struct rl_criteria *criteria)
{
    struct rl_trial trial = stretch->trial;
    if (rl_llr_upper_bound(criteria, &trial, &stretch->summary) <
        (float)RL_MOST * criteria->least) {
        return;
    }
    rl_view_place_bit_edges(&search->view, &trial);
    rl_view_integrate_and_dump(&search->view, &trial, lane / RL_LANES, &search->sums);
    rl_shortlist_add(&search->shortlist[lane], criteria, &trial, &search->sums, lane,
                     RL_PACKET_BITS);
}

static void search_stretches(struct rl_search *search, int count, int packets, double to_s,
                             const struct rl_criteria *criteria)
{
    struct kept kept[RL_MAX_CHANNELS];
    const double bit_s = search->view.samples->bit_s;
    const double half_bits = RL_PACKET_BITS * packets / 2.0;
    const int clocks = (int)(RL_MAX_SKEW * half_bits / 2 * RL_PHASES + 0.999);
    const double skew = RL_MAX_SKEW / clocks;
    /* The middles of all stretches lie within one bit. */
    const double middle_s = to_s - half_bits * bit_s * (1.0 + RL_MAX_SKEW);
    for (int lane = 0; lane < count; lane++) {
        kept[lane].count = 0;
    }
    for (int clock = -clocks; clock <= clocks; clock++) {
        for (int quarter = 0; quarter < RL_PHASES; quarter++) {
            struct rl_trial trial = {.packets = packets, .bit_s = bit_s * (1.0 + clock * skew)};
            trial.end_s = middle_s - quarter * bit_s / RL_PHASES + half_bits * trial.bit_s;
            rl_view_place_bit_edges(&search->view, &trial);
            integrate_all(search, &trial);
            for (int lane = 0; lane < count; lane++) {
                const struct rl_soft_summary *summary = &search->sums.summary[lane];
                const float expected = trial.energy.own * (float)packets * summary->power;
                const struct stretch one = {summary->squares / expected, trial, *summary};
                rl_keep_best(kept[lane].stretch, &kept[lane].count, RL_TRIED, &one, sizeof one);
            }
        }
    }
    for (int lane = 0; lane < count; lane++) {
        for (int i = 0; i < kept[lane].count; i++) {
            try_starts(search, lane, &kept[lane].stretch[i], criteria);
        }
    }
}

void rl_search_channels(struct rl_search *search, const struct rl_sought *sought,
                        const int *channels, int count, struct rl_hits *hits)
{
    const int packets = sought->packets;
    const double longest_bits =
        RL_PACKET_BITS * (packets > 0 ? packets : 1) * (1.0 + RL_MAX_SKEW);
    const double bits = packets > 0 ? longest_bits + 2.0 : longest_bits + RL_PACKET_BITS + 1.0;
    const double first_s =
        (packets > 0 ? sought->to_s : sought->from_s) - bits * search->view.samples->bit_s;
    plan(search);
    for (int strong = 0; strong < 2; strong++) {
        const struct rl_whitening *whitening =
            &search->whitening[!strong && packets == 0 ? FAINT_LONE : strong];
        int chosen[RL_MAX_CHANNELS], index[RL_MAX_CHANNELS], lanes = 0;
        for (int i = 0; i < count; i++) {
            if ((rl_noise_variation(search->view.samples, channels[i]) > RL_STRONG) == strong) {
                chosen[lanes] = channels[i];
                search->shortlist[lanes].words = search->shortlist[lanes].sequences = 0;
                index[lanes++] = i;
            }
        }
        if (lanes == 0) {
            continue;
        }
        const double least = strong ? STRONG_SHARE * sought->least : sought->least;
        const struct rl_criteria criteria = {(float)least, (float)sought->max_llr_deficit,
                                             packets > 0, &whitening->smooth};
        rl_view_open(&search->view, chosen, lanes, fmax(first_s, sought->since_s), sought->to_s,
                     whitening->walk);
        if (packets > 0) {
            search_stretches(search, lanes, packets, sought->to_s, &criteria);
        } else {
            search_ended(search, lanes, sought->from_s, sought->to_s, &criteria);
        }
        const int dropped = rl_shortlists_ration(search->shortlist, lanes, &search->words_left);
        search->dropped = search->dropped || dropped > 0;
        for (int lane = 0; lane < lanes; lane++) {
            rl_hits_find(&hits[index[lane]], &search->shortlist[lane], &search->codebook,
                         &criteria);
        }
    }
}
