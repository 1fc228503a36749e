/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_packet.h"

/* Rows of the parity matrix: a circulant in which entry (i, j) is 1 where i + j mod 11 is one of
 * 0, 2, 6, 7, 8, 10, bordered by ones and a zero. Any rotation of the rows makes a Golay code, but
 * with this one no packet comes within one bit of a cyclic shift of another, and 3593 of the 4096
 * keep four bits away from all of them.
 */
static const uint16_t PARITY[RL_ID_BITS] = {
    0xA3B, 0x477, 0x8ED, 0x1DB, 0x3B5, 0x769, 0xED1, 0xDA3, 0xB47, 0x68F, 0xD1D, 0xFFE,
};

enum { IDS = 1 << RL_ID_BITS };

bool rl_id_is_usable(uint32_t id)
{
    return id > 0 && id < IDS - 1;
}

uint32_t rl_golay_word(uint16_t id)
{
    uint16_t parity = 0;
    for (uint8_t row = 0; row < RL_ID_BITS; row++) {
        if (id & (1u << (RL_ID_BITS - 1 - row))) {
            parity ^= PARITY[row];
        }
    }
    return (uint32_t)(id & (IDS - 1)) << RL_ID_BITS | parity;
}

uint32_t rl_packet(uint16_t id)
{
    return (uint32_t)RL_PREAMBLE << RL_WORD_BITS | rl_golay_word(id);
}

void rl_schedule_start(struct rl_schedule *schedule, uint32_t packet, uint16_t packets)
{
    schedule->packet = packet;
    schedule->packets_left = packets;
    schedule->bits_left = 0;
}

bool rl_schedule_next(struct rl_schedule *schedule, bool *dark)
{
    if (schedule->bits_left == 0) {
        if (schedule->packets_left == 0) {
            return false;
        }
        schedule->packets_left--;
        schedule->bits_left = RL_PACKET_BITS;
    }
    schedule->bits_left--;
    *dark = (schedule->packet >> schedule->bits_left) & 1u;
    return true;
}
