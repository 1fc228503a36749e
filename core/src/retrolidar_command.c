/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_command.h"

#include <stddef.h>

#include "retrolidar_packet.h"

bool rl_line_take(struct rl_line *line, char typed)
{
    if (typed != '\r' && typed != '\n') {
        if (line->length < sizeof line->text - 1) {
            line->text[line->length++] = typed;
        } else {
            line->text[0] = '?'; /* too long to be a command, even if its beginning is one */
        }
        return false;
    }
    line->text[line->length] = '\0';
    bool is_line = line->length > 0;
    line->length = 0;
    return is_line;
}

static bool is_same(const char *line, const char *command)
{
    while (*line == *command && *line != '\0') {
        line++;
        command++;
    }
    return *line == *command;
}

enum rl_command rl_command_of(const char *line)
{
    return is_same(line, "identify") ? RL_IDENTIFY
           : is_same(line, "start")  ? RL_START
           : is_same(line, "stop")   ? RL_STOP
           : is_same(line, "reset")  ? RL_RESET
                                     : RL_NO_COMMAND;
}

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
