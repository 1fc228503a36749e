/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_command.h"

#include <stddef.h>

#include "retrolidar_packet.h"

uint16_t rl_command_id(const char *line)
{
    static const char COMMAND[] = "id ";
    uint32_t id = 0;
    for (size_t i = 0; COMMAND[i] != '\0'; i++) {
        if (*line++ != COMMAND[i]) {
            return 0;
        }
    }
    for (; *line != '\0'; line++) {
        if (*line < '0' || *line > '9' || id > 4095) {
            return 0;
        }
        id = 10 * id + (uint32_t)(*line - '0');
    }
    return rl_id_is_usable(id) ? (uint16_t)id : 0;
}
