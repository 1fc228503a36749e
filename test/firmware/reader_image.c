/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * All that a reader calls of the core, linked without any other code.
 */
#include "retrolidar_command.h"
#include "retrolidar_wire.h"

volatile uint32_t counter_us;
uint8_t line[RL_WIRE_BYTES(64)];
static struct rl_zone zones[64];

size_t start(const char *raw)
{
    static struct rl_line typed;
    static struct rl_identity identity;
    if (rl_line_take(&typed, raw[5]) && rl_command_of(typed.text) != RL_NO_COMMAND) {
        return rl_wire_encode_identity(&identity, line);
    }
    static uint64_t now_us;
    struct rl_frame frame = {0, 0, 8, zones};
    now_us = rl_extend_us(now_us, counter_us);
    frame.sensor_time_us = now_us;
    for (uint8_t i = 0; i < 64; i++) {
        zones[i] = rl_zone_of((uint8_t)raw[0], raw[1], (uint8_t)raw[2], (uint8_t)raw[3],
                              (uint8_t)raw[4]);
    }
    return rl_wire_encode(&frame, line, sizeof line);
}
