/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The packets that may come, and which of them explains soft bits best. */
#ifndef RETROLIDAR_CODEBOOK_H
#define RETROLIDAR_CODEBOOK_H

#include "retrolidar_packet.h"

enum { RL_GROUPS = 256 };

/* Energy of a sum of bits, taken as stationary:
 *     own n_1 + 2 adjacent n_11 - smooth n_1 - sum over lags of pair decay^(lag - 1) n_lag
 * where n_1 counts dark bits and n_lag pairs of them that far apart. The first two are of the light
 * that falls in each exposure, the others of what whitening takes off it.
 */
struct rl_energy {
    float own, adjacent;
    float smooth, pair, decay; /* pairs counted in both orders */
};

/* Packets whose words begin with the same byte, and bounds of their energies. */
struct rl_group {
    int first, count;
    uint8_t high;      /* that byte */
    float dark, pairs; /* least of all */
};

struct rl_codebook {
    int words, groups;
    uint16_t id[RL_IDS];
    uint32_t packet[RL_IDS];
    float dark[RL_IDS];  /* n_1 */
    float pairs[RL_IDS]; /* 2 n_11 */
    struct rl_group group[RL_GROUPS];
};

/* What whitening takes off the energy of each word; the least energy in each group, at the energies
 * of bits that are of reference; and what whitening takes off the bits of each byte by themselves,
 * with what the bytes before it leave, and what it leaves itself.
 */
struct rl_smooth {
    float word[RL_IDS];
    float own, adjacent, group[RL_GROUPS];
    float alone[256], after[256], left[256];
    float decay; /* of what is left, a byte later */
};

/* Take IDs, rising and usable ones only; all usable ones if there are none. */
void rl_codebook_start(struct rl_codebook *codebook, const uint16_t *ids, int count);

/* Tabulate what whitening takes off the energy of bytes and packets; the energy is of reference. */
void rl_codebook_smooth(const struct rl_codebook *codebook, const struct rl_energy *energy,
                        struct rl_smooth *smooth);

/* Energy of dark bits, in the order in which they are sent. */
float rl_energy_of(const struct rl_energy *energy, const struct rl_smooth *smooth, uint32_t bits);

struct rl_word {
    int index;     /* in the codebook; -1 = none explains anything */
    float squared; /* of the sum of its dark soft bits, over its energy */
};

/* The two best packets for soft bits (RL_PACKET_BITS, positive = dark), of those that exceed
 * `least`.
 *
 * seen: bits of the window that were seen; the others have no energy
 * shift: bit of the window with which the packet begins
 */
void rl_codebook_best(const struct rl_codebook *codebook, const struct rl_energy *energy,
                      const struct rl_smooth *smooth, const float *soft, uint32_t seen, int shift,
                      float least, struct rl_word best[2]);

/* The packet, of another ID than this, with the greatest sum of weights over its dark bits. */
int rl_codebook_heaviest(const struct rl_codebook *codebook, const float *weight, uint16_t id);

#endif
