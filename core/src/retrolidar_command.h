/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Commands of a person to a marker over its serial line. */
#ifndef RETROLIDAR_COMMAND_H
#define RETROLIDAR_COMMAND_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The ID that a line such as "id 2073" sets, its end of line removed; 0, which is reserved, if the
 * line says anything else or names an ID that cannot be used.
 */
uint16_t rl_command_id(const char *line);

#ifdef __cplusplus
}
#endif

#endif
