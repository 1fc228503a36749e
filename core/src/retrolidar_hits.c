/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The hits of a search in one channel, the best first. */
#include "retrolidar_search.h"

#include <math.h>
#include <string.h>

static const uint32_t PREAMBLE = (uint32_t)RL_PREAMBLE << RL_WORD_BITS;
static const uint32_t WORD_MASK = ((uint32_t)1 << RL_WORD_BITS) - 1;
/* Coarse templates explain no more than this. */
static const float MAX_EXPLAINED = 0.995f;

/* Log likelihood ratio: -1/2 samples log(share of the power that is left). */
static float nats_of(float squared, const struct rl_soft_summary *summary)
{
    return -0.5f * summary->samples * log1pf(-rl_minf(squared / summary->power, MAX_EXPLAINED));
}

/* The power that must be explained for so many nats. */
static float min_of(float nats, const struct rl_soft_summary *summary)
{
    return summary->power * (1.0f - expf(-2.0f * nats / summary->samples));
}

/* Keep an item if it is among the best, and better than the kept one of its kind; same: index of
 * that, or the count if there is none.
 */
static void keep_best_of_kind(void *kept, int *count, int max_count, int same, const void *item,
                              size_t size)
{
    char *other = (char *)kept + (size_t)same * size;
    if (same < *count) {
        if (*(const float *)(const void *)other >= *(const float *)item) {
            return;
        }
        (*count)--;
        memmove(other, other + size, (size_t)(*count - same) * size);
    }
    rl_keep_best(kept, count, max_count, item, size);
}

/* Keep the best sequence of each clock. */
static void keep_sequence(struct rl_shortlist *shortlist, const struct rl_shortlist_entry *entry)
{
    struct rl_shortlist_entry *kept = shortlist->sequence;
    int same = 0;
    while (same < shortlist->sequences && kept[same].trial.bit_s != entry->trial.bit_s) {
        same++;
    }
    keep_best_of_kind(kept, &shortlist->sequences, RL_TRIED, same, entry, sizeof *entry);
}

/* The power that the best sequence of bits explains. */
static float any_squared(const struct rl_criteria *criteria, const struct rl_trial *trial,
                         const struct rl_soft_summary *summary)
{
    if (summary->dark == 0 || summary->samples < 2.0f) {
        return 0.0f;
    }
    return summary->any * summary->any /
           (rl_energy_of(&trial->energy, criteria->smooth, summary->dark) * (float)trial->packets);
}

float rl_llr_upper_bound(const struct rl_criteria *criteria, const struct rl_trial *trial,
                         const struct rl_soft_summary *summary)
{
    return nats_of(any_squared(criteria, trial, summary), summary);
}

void rl_shortlist_add(struct rl_shortlist *shortlist, const struct rl_criteria *criteria,
                      const struct rl_trial *trial, const struct rl_sums *sums, int lane,
                      int shifts)
{
    const struct rl_soft_summary *summary = &sums->summary[lane];
    const float any = any_squared(criteria, trial, summary);
    const float least = min_of(criteria->least, summary);
    if (!(any > 0.0f && any >= least)) {
        return;
    }
    const float upper_bound = nats_of(any, summary);
    struct rl_shortlist_entry entry = {upper_bound, 0, *trial, .summary = *summary};
    /* If only a part is seen, the preamble may be missing, so all starts are kept. */
    const int max_words = shifts > 1 && trial->seen != RL_ALL_BITS ? RL_PACKET_BITS : RL_HITS;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        entry.soft[bit] = sums->soft[lane / RL_LANES][bit][lane % RL_LANES];
    }
    keep_sequence(shortlist, &entry);
    float twice[2 * RL_PACKET_BITS], until[2 * RL_PACKET_BITS + 1] = {0.0f};
    memcpy(twice, entry.soft, sizeof entry.soft);
    memcpy(twice + RL_PACKET_BITS, entry.soft, sizeof entry.soft);
    for (int bit = 0; bit < RL_PACKET_BITS + shifts - 1; bit++) {
        until[bit + 1] = until[bit] + rl_maxf(twice[bit], 0.0f);
    }
    for (int shift = 0; shift < shifts; shift++) {
        const float word = until[shift + RL_PACKET_BITS] - until[shift + RL_PREAMBLE_BITS];
        const float sum = rl_add_preamble(word, twice + shift);
        if (sum <= 0.0f) {
            continue;
        }
        const uint32_t dark = rl_rotate_bits(summary->dark, shift) & WORD_MASK;
        const uint32_t bits = rl_rotate_bits(PREAMBLE | dark, RL_PACKET_BITS - shift) & trial->seen;
        const float squared =
            sum * sum /
            (rl_energy_of(&trial->energy, criteria->smooth, bits) * (float)trial->packets);
        if (squared < least) {
            continue;
        }
        entry.nats = nats_of(squared, summary);
        entry.shift = shift;
        if (upper_bound - entry.nats <= criteria->max_llr_deficit) {
            rl_keep_best(shortlist->word, &shortlist->words, max_words, &entry, sizeof entry);
        }
    }
}

/* The sequence of bits that explains most: from the signs of the soft bits, by flipping one at a
 * time. In a long run of equal bits the level follows their light, so their signs say little.
 */
static uint32_t best_bits(const struct rl_shortlist_entry *entry, const struct rl_smooth *smooth)
{
    const struct rl_energy *energy = &entry->trial.energy;
    float sum = entry->summary.any;
    uint32_t bits = entry->summary.dark;
    float best = sum * sum / rl_energy_of(energy, smooth, bits);
    for (int flipped = 0; flipped >= 0;) {
        float best_sum = sum;
        flipped = -1;
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            const uint32_t other = bits ^ rl_packet_bit(bit);
            const float other_sum = other & ~bits ? sum + entry->soft[bit] : sum - entry->soft[bit];
            if (other == 0 || other_sum <= 0.0f) {
                continue;
            }
            const float squared = other_sum * other_sum / rl_energy_of(energy, smooth, other);
            if (squared > best) {
                best = squared;
                flipped = bit;
                best_sum = other_sum;
            }
        }
        if (flipped >= 0) {
            bits ^= rl_packet_bit(flipped);
            sum = best_sum;
        }
    }
    return bits;
}

static double start_of(const struct rl_trial *trial)
{
    return trial->end_s - RL_PACKET_BITS * trial->packets * trial->bit_s;
}

/* Keep the best hit of each ID. */
static void keep_hit(struct rl_hits *hits, const struct rl_hit *hit)
{
    int same = 0;
    while (same < hits->count && hits->hit[same].id != hit->id) {
        same++;
    }
    keep_best_of_kind(hits->hit, &hits->count, RL_HITS, same, hit, sizeof *hit);
}

int rl_shortlists_ration(struct rl_shortlist *shortlist, int channels, int *left)
{
    int words = 0, dropped = 0;
    for (int channel = 0; channel < channels; channel++) {
        words += shortlist[channel].words;
    }
    for (; words - dropped > *left; dropped++) {
        struct rl_shortlist *least = NULL;
        for (int channel = 0; channel < channels; channel++) {
            struct rl_shortlist *one = &shortlist[channel];
            if (one->words > 0 && (least == NULL || one->word[one->words - 1].nats <
                                                        least->word[least->words - 1].nats)) {
                least = one;
            }
        }
        least->words--;
    }
    *left -= words - dropped;
    return dropped;
}

void rl_hits_find(struct rl_hits *hits, const struct rl_shortlist *shortlist,
                  const struct rl_codebook *codebook, const struct rl_criteria *criteria)
{
    hits->count = hits->sequences = 0;
    for (int word = 0; word < shortlist->words; word++) {
        const struct rl_shortlist_entry *entry = &shortlist->word[word];
        const struct rl_trial *trial = &entry->trial;
        const float packets = (float)trial->packets;
        /* A word that other bits exceed by so much is neither a packet nor a rival. */
        const float upper_bound = rl_llr_upper_bound(criteria, trial, &entry->summary);
        const float min_nats =
            rl_maxf(criteria->least, upper_bound - 2.0f * criteria->max_llr_deficit);
        const float least = min_of(min_nats, &entry->summary);
        float soft[RL_PACKET_BITS];
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            soft[bit] = entry->soft[(bit + entry->shift) % RL_PACKET_BITS];
        }
        struct rl_word best[2];
        rl_codebook_best(codebook, &trial->energy, criteria->smooth, soft,
                         trial->seen, entry->shift, least * packets, best);
        for (int i = 0; i < 2 && best[i].index >= 0; i++) {
            /* The packet that began first in the window, or before it. */
            const int begin = entry->shift > 0 ? entry->shift - RL_PACKET_BITS : 0;
            const struct rl_hit hit = {
                .nats = nats_of(best[i].squared / packets, &entry->summary),
                .id = codebook->id[best[i].index],
                .transmission = {.bits = codebook->packet[best[i].index],
                                 .repeats = criteria->repeats,
                                 .start_s = start_of(trial) + begin * trial->bit_s,
                                 .bit_s = trial->bit_s},
            };
            keep_hit(hits, &hit);
        }
    }
    for (int i = 0; hits->count > 0 && i < shortlist->sequences; i++) {
        const struct rl_shortlist_entry *entry = &shortlist->sequence[i];
        hits->sequence[hits->sequences++] = (struct rl_transmission){
            .bits = best_bits(entry, criteria->smooth),
            .repeats = criteria->repeats,
            .start_s = start_of(&entry->trial),
            .bit_s = entry->trial.bit_s,
        };
    }
}
