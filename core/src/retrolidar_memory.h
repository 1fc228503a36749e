/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* One block of memory, from which arrays are taken one after the other. */
#ifndef RETROLIDAR_MEMORY_H
#define RETROLIDAR_MEMORY_H

#include <stddef.h>
#include <stdint.h>

struct rl_memory {
    char *block;   /* NULL while it is only counted how much there must be */
    int64_t taken; /* bytes */
};

/* Take an array, aligned for any type; NULL while it is counted. */
static inline void *rl_take(struct rl_memory *memory, int64_t bytes)
{
    const int64_t at = memory->taken;
    memory->taken += (bytes + 15) / 16 * 16;
    return memory->block == NULL ? NULL : memory->block + at;
}

#endif
