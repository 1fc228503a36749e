/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_codebook.h"

#include "retrolidar_math.h"

#include <math.h>

enum { IDS = 1 << RL_ID_BITS, PREAMBLE_BITS = RL_PACKET_BITS - RL_WORD_BITS };

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
    for (int index = 0; index < (count > 0 ? count : IDS); index++) {
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
        struct rl_group *group = &codebook->group[codebook->groups - 1];
        if (word == 0 || group->high != id >> 4) {
            group = &codebook->group[codebook->groups++];
            *group = (struct rl_group){word, 0, (uint8_t)(id >> 4), INFINITY, INFINITY};
        }
        group->count++;
        group->dark = rl_minf(group->dark, codebook->dark[word]);
        group->pairs = rl_minf(group->pairs, codebook->pairs[word]);
    }
}

static float smooth_of(const struct rl_energy *energy, uint32_t bits)
{
    float sum = 0.0f;
    for (int lag = 0; lag < RL_PACKET_BITS; lag++) {
        sum += energy->smooth[lag] * (float)count_bits(bits & bits >> lag);
    }
    return sum;
}

void rl_codebook_smooth(const struct rl_codebook *codebook, const struct rl_energy *energy,
                        struct rl_smooth *smooth)
{
    for (int g = 0; g < codebook->groups; g++) {
        const struct rl_group *group = &codebook->group[g];
        smooth->group[g] = 0.0f;
        for (int word = group->first; word < group->first + group->count; word++) {
            smooth->word[word] = smooth_of(energy, codebook->packet[word]);
            smooth->group[g] = rl_maxf(smooth->group[g], smooth->word[word]);
        }
    }
}

float rl_energy_of(const struct rl_energy *energy, uint32_t bits)
{
    return energy->own * (float)count_bits(bits) +
           2.0f * energy->adjacent * (float)count_bits(bits & bits >> 1) - smooth_of(energy, bits);
}

/* Sums of weights over the dark bits of every byte. */
static void tabulate(const float *weight, float *table)
{
    table[0] = 0.0f;
    for (int bit = 0; bit < 8; bit++) {
        const int size = 1 << bit;
        for (int low = 0; low < size; low++) {
            table[size + low] = table[low] + weight[7 - bit];
        }
    }
}

static float most_of(const float *table)
{
    float most = 0.0f;
    for (int byte = 0; byte < 256; byte++) {
        most = rl_maxf(most, table[byte]);
    }
    return most;
}

void rl_codebook_best(const struct rl_codebook *codebook, const struct rl_energy *energy,
                      const struct rl_smooth *smooth, const float *soft, float least,
                      struct rl_word best[2])
{
    float table[3][256];
    for (int byte = 0; byte < 3; byte++) {
        tabulate(soft + PREAMBLE_BITS + 8 * byte, table[byte]);
    }
    const float preamble = soft[0] + soft[2] + soft[4] + soft[6];
    const float most_low = most_of(table[1]) + most_of(table[2]);
    best[0] = best[1] = (struct rl_word){-1, least};
    for (int g = 0; g < codebook->groups; g++) {
        const struct rl_group *group = &codebook->group[g];
        const float high = preamble + table[0][group->high];
        const float least_power = energy->own * group->dark + energy->adjacent * group->pairs -
                                  smooth->group[g];
        const float most = high + most_low;
        if (most <= 0.0f || most * most <= best[1].squared * least_power) {
            continue;
        }
        for (int word = group->first; word < group->first + group->count; word++) {
            const uint32_t packet = codebook->packet[word];
            const float sum = high + table[1][packet >> 8 & 255u] + table[2][packet & 255u];
            const float power = energy->own * codebook->dark[word] +
                                energy->adjacent * codebook->pairs[word] - smooth->word[word];
            if (sum <= 0.0f || sum * sum <= best[1].squared * power) {
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
    float table[3][256], most = -INFINITY;
    int heaviest = -1;
    for (int byte = 0; byte < 3; byte++) {
        tabulate(weight + PREAMBLE_BITS + 8 * byte, table[byte]);
    }
    for (int word = 0; word < codebook->words; word++) {
        const uint32_t packet = codebook->packet[word];
        const float sum = table[0][packet >> 16 & 255u] + table[1][packet >> 8 & 255u] +
                          table[2][packet & 255u];
        if (sum > most && codebook->id[word] != id) {
            most = sum;
            heaviest = word;
        }
    }
    return heaviest;
}
