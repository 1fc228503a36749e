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
