/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a marker sends: a preamble of 7 bits and an extended Golay (24, 12) word, first the most
 * significant bit. A bit 1 is dark.
 */
#ifndef RETROLIDAR_PACKET_H
#define RETROLIDAR_PACKET_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* binding */
enum { RL_PACKET_BITS = 31, RL_WORD_BITS = 24, RL_ID_BITS = 12, RL_PREAMBLE = 0x55 };

/* Whether an ID can be sent: 0 and 4095 are all bright and all dark after the preamble. */
bool rl_id_is_usable(uint32_t id);

/* The Golay word of an ID of 0 to 4095, in the lower 24 bits: the ID, then its parity. */
uint32_t rl_golay_word(uint16_t id);

/* Preamble and word of an ID of 0 to 4095, in the lower 31 bits. */
uint32_t rl_packet(uint16_t id);
/* end of binding */

/* One bit of a packet, the first one being 0. */
static inline uint32_t rl_packet_bit(int bit)
{
    return (uint32_t)1 << (RL_PACKET_BITS - 1 - bit);
}

/* Packets on their way, back to back. */
struct rl_schedule {
    uint32_t packet;
    uint16_t packets_left; /* after the one that is being sent */
    uint8_t bits_left;     /* of that one */
};

/* Begin with the first bit of the first of so many packets; none if there are 0. */
void rl_schedule_start(struct rl_schedule *schedule, uint32_t packet, uint16_t packets);

/* Take the next bit: true and whether it is dark, or false when all have been sent. */
bool rl_schedule_next(struct rl_schedule *schedule, bool *dark);

#ifdef __cplusplus
}
#endif

#endif
