/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* All packets that may be sent, and which of them fit soft bits best. */
#ifndef RETROLIDAR_CODEBOOK_H
#define RETROLIDAR_CODEBOOK_H

#include "retrolidar_packet.h"

enum { RL_GROUPS = 256 };

/* Energy of a sum of bits, taken as stationary:
 *     own n_1 + 2 adjacent n_11 - smooth n_1 - sum over lags of pair decay^(lag - 1) n_lag
 * where n_1 counts dark bits, and n_lag pairs of them at that lag. The first two terms are the
 * energy of the light in the exposures; the others are what whitening removes.
 */
struct rl_energy {
    float own, adjacent;
    float smooth, pair, decay; /* pairs counted in both orders */
};

/* Packets whose words begin with the same byte. */
struct rl_group {
    int first, count;
    float dark, pairs; /* the least of n_1 and 2 n_11 */
};

struct rl_codebook {
    int words, groups;
    uint16_t id[RL_IDS];
    uint32_t packet[RL_IDS];
    float dark[RL_IDS];  /* n_1 */
    float pairs[RL_IDS]; /* 2 n_11 */
    struct rl_group group[RL_GROUPS];
};

/* Energy that whitening removes, tabulated. `word`: of each packet. `group`: least energy left in
 * each group, at these energies of bits. `alone`: of the bits of a byte; `after`: factor
 * of what the bytes before it left over; `left`: what the byte leaves over for the next ones.
 */
struct rl_smooth {
    float word[RL_IDS];
    struct rl_energy energy;
    float group[RL_GROUPS];
    float alone[256], after[256], left[256];
    float decay; /* of what is left over, per byte */
};

/* Take the usable ones of some IDs, which rise; all usable IDs if there are none. */
void rl_codebook_start(struct rl_codebook *codebook, const uint16_t *ids, int count);

/* Tabulate the energy that whitening removes from bytes and packets. */
void rl_codebook_smooth(const struct rl_codebook *codebook, const struct rl_energy *energy,
                        struct rl_smooth *smooth);

/* Energy of dark bits, given as a mask in the order in which they are sent. */
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
