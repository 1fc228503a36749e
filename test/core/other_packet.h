/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A packet of 27 bits: another preamble, and words of a (21, 9) code, a Golay code cut by three bits. */
#ifndef RETROLIDAR_PACKET_FORMAT_H
#define RETROLIDAR_PACKET_FORMAT_H

#include <stdint.h>

/* binding */
enum { RL_PREAMBLE_BITS = 6, RL_PREAMBLE = 0x34, RL_WORD_BITS = 21, RL_ID_BITS = 9 };
enum { RL_WORD_DISTANCE = 8 };
/* end of binding */

enum { RL_MAX_DARK_BITS = 12, RL_USUAL_CHANGES = 8 };

static inline uint32_t rl_encode(uint32_t id)
{
    static const uint16_t PARITY[RL_ID_BITS] = {
        0x1DB, 0x3B5, 0x769, 0xED1, 0xDA3, 0xB47, 0x68F, 0xD1D, 0xFFE,
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
