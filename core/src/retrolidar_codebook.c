/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_codebook.h"

#include "retrolidar_math.h"

#include <math.h>

/* A word as bytes, of which the last may have spare bits. */
enum { WORD_BYTES = (RL_WORD_BITS + 7) / 8, SPARE_BITS = 8 * WORD_BYTES - RL_WORD_BITS };

/* Least share of the energy that whitening leaves. The formula would leave a negative energy of
 * some packets whose bits last as long as a frame, or of which only a part is seen.
 */
static const float MIN_ENERGY = 0.05f;

static uint8_t word_byte(uint32_t packet, int byte)
{
    return (uint8_t)((packet << SPARE_BITS) >> 8 * (WORD_BYTES - 1 - byte));
}

static int count_bits(uint32_t bits)
{
    bits -= (bits >> 1) & 0x55555555u;
    bits = (bits & 0x33333333u) + ((bits >> 2) & 0x33333333u);
    bits = (bits + (bits >> 4)) & 0x0F0F0F0Fu;
    return (int)((bits * 0x01010101u) >> 24);
}

void rl_codebook_start(struct rl_codebook *codebook, const uint16_t *ids, int count)
{
    codebook->words = codebook->groups = 0;
    for (int index = 0; index < (count > 0 ? count : RL_IDS); index++) {
        const uint16_t id = count > 0 ? ids[index] : (uint16_t)index;
        if (!rl_id_is_usable(id)) {
            continue;
        }
        const int word = codebook->words++;
        const uint32_t packet = rl_packet(id);
        codebook->id[word] = id;
        codebook->packet[word] = packet;
        codebook->dark[word] = (float)count_bits(packet);
        codebook->pairs[word] = 2.0f * (float)count_bits(packet & packet >> 1);
        if (word == 0 || word_byte(packet, 0) != word_byte(codebook->packet[word - 1], 0)) {
            codebook->group[codebook->groups++] = (struct rl_group){word, 0, INFINITY, INFINITY};
        }
        struct rl_group *group = &codebook->group[codebook->groups - 1];
        group->count++;
        group->dark = rl_minf(group->dark, codebook->dark[word]);
        group->pairs = rl_minf(group->pairs, codebook->pairs[word]);
    }
}

static float smooth_of(const struct rl_smooth *smooth, uint32_t bits)
{
    float sum = 0.0f, left = 0.0f;
    for (int shift = 24; shift >= 0; shift -= 8) {
        const uint32_t byte = bits >> shift & 255u;
        sum += smooth->alone[byte] + smooth->after[byte] * left;
        left = smooth->decay * left + smooth->left[byte];
    }
    return sum;
}

void rl_codebook_smooth(const struct rl_codebook *codebook, const struct rl_energy *energy,
                        struct rl_smooth *smooth)
{
    smooth->energy = *energy;
    for (int byte = 0; byte < 256; byte++) {
        float alone = 0.0f, after = 0.0f, left = 0.0f, faded = 1.0f;
        for (int bit = 7; bit >= 0; bit--) {
            const float dark = (float)(byte >> bit & 1);
            alone += dark * (energy->smooth + left);
            after += dark * faded;
            left = energy->decay * left + dark * energy->pair;
            faded *= energy->decay;
        }
        smooth->alone[byte] = alone;
        smooth->after[byte] = after;
        smooth->left[byte] = left;
        smooth->decay = faded;
    }
    for (int g = 0; g < codebook->groups; g++) {
        const struct rl_group *group = &codebook->group[g];
        smooth->group[g] = INFINITY;
        for (int word = group->first; word < group->first + group->count; word++) {
            smooth->word[word] = smooth_of(smooth, codebook->packet[word]);
            const float power = energy->own * codebook->dark[word] +
                                energy->adjacent * codebook->pairs[word] - smooth->word[word];
            smooth->group[g] = rl_minf(smooth->group[g], power);
        }
    }
}

/* Energy of dark bits and pairs of them, less what whitening removes. */
static inline float energy_left(const struct rl_energy *energy, float dark, float pairs,
                                float taken)
{
    const float own = energy->own * dark;
    return rl_maxf(own + energy->adjacent * pairs - taken, MIN_ENERGY * own);
}

float rl_energy_of(const struct rl_energy *energy, const struct rl_smooth *smooth, uint32_t bits)
{
    return energy_left(energy, (float)count_bits(bits),
                       2.0f * (float)count_bits(bits & bits >> 1), smooth_of(smooth, bits));
}

/* Sums of weights over the dark bits of every byte of a word. */
static void tabulate(const float *weight, float table[WORD_BYTES][256])
{
    for (int byte = 0; byte < WORD_BYTES; byte++) {
        table[byte][0] = 0.0f;
        for (int bit = 0; bit < 8; bit++) {
            const int size = 1 << bit, of = RL_PREAMBLE_BITS + 8 * byte + 7 - bit;
            const float added = of < RL_PACKET_BITS ? weight[of] : 0.0f;
            for (int low = 0; low < size; low++) {
                table[byte][size + low] = table[byte][low] + added;
            }
        }
    }
}

/* The sum of weights over the dark bits of a word; sum: over the first byte. */
static inline float sum_of(float sum, uint32_t packet, const float table[WORD_BYTES][256])
{
    for (int byte = 1; byte < WORD_BYTES; byte++) {
        sum += table[byte][word_byte(packet, byte)];
    }
    return sum;
}

/* A bound of the least energy of a group, from that at the tabulated energies of bits. */
static float min_power(const struct rl_energy *energy, const struct rl_smooth *smooth,
                       const struct rl_group *group, float least)
{
    const float own = energy->own - smooth->energy.own;
    const float adjacent = energy->adjacent - smooth->energy.adjacent;
    return least + own * (own > 0.0f ? group->dark : (float)RL_PACKET_BITS) +
           adjacent * (adjacent > 0.0f ? group->pairs : 2.0f * RL_PACKET_BITS);
}

void rl_codebook_best(const struct rl_codebook *codebook, const struct rl_energy *energy,
                      const struct rl_smooth *smooth, const float *soft, uint32_t seen, int shift,
                      float least, struct rl_word best[2])
{
    const bool is_whole = seen == RL_ALL_BITS;
    const int first = RL_PACKET_BITS - shift; /* bit of the packet with which the window begins */
    float table[WORD_BYTES][256], max_low = 0.0f;
    tabulate(soft, table);
    const float preamble = rl_add_preamble(0.0f, soft);
    for (int bit = RL_PREAMBLE_BITS + 8; bit < RL_PACKET_BITS; bit++) {
        max_low += rl_maxf(soft[bit], 0.0f);
    }
    best[0] = best[1] = (struct rl_word){-1, least};
    for (int g = 0; g < codebook->groups; g++) {
        const struct rl_group *group = &codebook->group[g];
        const float high = preamble + table[0][word_byte(codebook->packet[group->first], 0)];
        const float power_of_any =
            is_whole ? rl_maxf(min_power(energy, smooth, group, smooth->group[g]), 0.0f) : 0.0f;
        const float min_sum = sqrtf(best[1].squared * power_of_any);
        if (high + max_low <= min_sum) {
            continue;
        }
        for (int word = group->first; word < group->first + group->count; word++) {
            const uint32_t packet = codebook->packet[word];
            const float sum = sum_of(high, packet, (const float (*)[256])table);
            if (sum <= min_sum) {
                continue;
            }
            const float power =
                is_whole ? energy_left(energy, codebook->dark[word], codebook->pairs[word],
                                       smooth->word[word])
                         : rl_energy_of(energy, smooth, rl_rotate_bits(packet, first) & seen);
            if (sum * sum <= best[1].squared * power) {
                continue;
            }
            best[1] = (struct rl_word){word, sum * sum / power};
            if (best[1].squared > best[0].squared) {
                const struct rl_word better = best[1];
                best[1] = best[0];
                best[0] = better;
            }
        }
    }
}

int rl_codebook_heaviest(const struct rl_codebook *codebook, const float *weight, uint16_t id)
{
    float table[WORD_BYTES][256], most = -INFINITY;
    int heaviest = -1;
    tabulate(weight, table);
    for (int word = 0; word < codebook->words; word++) {
        const uint32_t packet = codebook->packet[word];
        const float sum =
            sum_of(table[0][word_byte(packet, 0)], packet, (const float (*)[256])table);
        if (sum > most && codebook->id[word] != id) {
            most = sum;
            heaviest = word;
        }
    }
    return heaviest;
}
