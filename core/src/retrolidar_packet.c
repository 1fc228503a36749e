/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_packet.h"

static const uint32_t WORD_MASK = ((uint32_t)1 << RL_WORD_BITS) - 1;

bool rl_id_is_usable(uint32_t id)
{
    const uint32_t word = id < RL_IDS ? rl_encode(id) : 0;
    return word != 0 && word != WORD_MASK;
}

uint32_t rl_packet(uint16_t id)
{
    return (uint32_t)RL_PREAMBLE << RL_WORD_BITS | rl_encode(id & (RL_IDS - 1));
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
