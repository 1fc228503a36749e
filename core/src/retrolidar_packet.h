/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a marker sends: packets of the format in retrolidar_packet_format.h. */
#ifndef RETROLIDAR_PACKET_H
#define RETROLIDAR_PACKET_H

#include "retrolidar_packet_format.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* binding */
enum { RL_PACKET_BITS = RL_PREAMBLE_BITS + RL_WORD_BITS, RL_IDS = 1 << RL_ID_BITS };

/* Whether an ID can be sent: not one whose word is all bright or all dark. */
bool rl_id_is_usable(uint32_t id);

/* Preamble and word of an ID, in the lower bits. */
uint32_t rl_packet(uint16_t id);
/* end of binding */

static const uint32_t RL_ALL_BITS = ((uint32_t)1 << RL_PACKET_BITS) - 1;

/* One bit of a packet, the first one being 0. */
static inline uint32_t rl_packet_bit(int bit)
{
    return (uint32_t)1 << (RL_PACKET_BITS - 1 - bit);
}

/* Which bit of a packet that repeats one is, counted from any of its packets. */
static inline int rl_bit_of(int bit)
{
    return (bit % RL_PACKET_BITS + RL_PACKET_BITS) % RL_PACKET_BITS;
}

/* The bits of a packet from one of them on; those before it follow the last. */
static inline uint32_t rl_rotate_bits(uint32_t bits, int first)
{
    return (bits << first | bits >> (RL_PACKET_BITS - first)) & RL_ALL_BITS;
}

/* Add the dark bits of the preamble to a sum over the bits of a packet. */
static inline float rl_add_preamble(float sum, const float *bits)
{
    for (int bit = 0; bit < RL_PREAMBLE_BITS; bit++) {
        sum += RL_PREAMBLE >> (RL_PREAMBLE_BITS - 1 - bit) & 1 ? bits[bit] : 0.0f;
    }
    return sum;
}

#ifdef __cplusplus
}
#endif

#endif
