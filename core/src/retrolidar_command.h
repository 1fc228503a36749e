/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Lines of text that a marker or a reader takes over its serial line. */
#ifndef RETROLIDAR_COMMAND_H
#define RETROLIDAR_COMMAND_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* A line that is being typed; all zeros before it is used for the first time. */
struct rl_line {
    char text[16];
    uint8_t length;
};

/* Take a character; return whether it ends a line, which is then the text, without its end. Empty
 * lines do not count, and of one that is too long the text begins with a question mark.
 */
bool rl_line_take(struct rl_line *line, char typed);

/* What a host wants of a reader. */
enum rl_command { RL_NO_COMMAND, RL_IDENTIFY, RL_START, RL_STOP, RL_RESET };

/* The command that a line is: identify, start, stop or reset. */
enum rl_command rl_command_of(const char *line);

/* The ID that a line such as "id 2073" sets, its end of line removed; 0, which is reserved, if the
 * line says anything else or names an ID that cannot be used.
 */
uint16_t rl_command_id(const char *line);

#ifdef __cplusplus
}
#endif

#endif
