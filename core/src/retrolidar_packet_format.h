/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The format of a packet: all that the core knows of it. To read another packet, replace this file.
 *
 * A packet is a preamble and a word, of at most 31 bits together, the most significant bit first; a
 * bit 1 is dark. The word begins with the ID.
 */
#ifndef RETROLIDAR_PACKET_FORMAT_H
#define RETROLIDAR_PACKET_FORMAT_H

#include <stdint.h>

/* binding */
enum { RL_PREAMBLE_BITS = 7, RL_PREAMBLE = 0x55, RL_WORD_BITS = 24, RL_ID_BITS = 12 };
enum { RL_WORD_DISTANCE = 8 }; /* bits in which two words differ at least */
/* end of binding */

enum {
    RL_MAX_DARK_BITS = 12, /* in a row; only one ID has more, even where packets repeat */
    RL_USUAL_CHANGES = 12, /* from bit to bit; with fewer (IDs 1, 4094) more evidence is needed */
};

/* The word of an ID: a row of the extended Golay (24, 12) code.
 *
 * Rows of the parity matrix: a circulant in which entry (i, j) is 1 where i + j mod 11 is one of
 * 0, 2, 6, 7, 8, 10, bordered by ones and a zero. Any rotation of the rows makes a Golay code, but
 * with this one no packet comes within one bit of a cyclic shift of another, and 3593 of the 4096
 * keep four bits away from all of them.
 */
static inline uint32_t rl_encode(uint32_t id)
{
    static const uint16_t PARITY[RL_ID_BITS] = {
        0xA3B, 0x477, 0x8ED, 0x1DB, 0x3B5, 0x769, 0xED1, 0xDA3, 0xB47, 0x68F, 0xD1D, 0xFFE,
    };
    uint32_t parity = 0;
    for (uint8_t row = 0; row < RL_ID_BITS; row++) {
        if (id & ((uint32_t)1 << (RL_ID_BITS - 1 - row))) {
            parity ^= PARITY[row];
        }
    }
    return id << (RL_WORD_BITS - RL_ID_BITS) | parity;
}

#endif
