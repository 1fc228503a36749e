/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What the C library lacks. */
#ifndef RETROLIDAR_MATH_H
#define RETROLIDAR_MATH_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

/* Minimum and maximum that compile to an instruction; unlike with fmin and fmax, a NaN may come
 * through.
 */
static inline float rl_minf(float a, float b)
{
    return a < b ? a : b;
}

static inline float rl_maxf(float a, float b)
{
    return a > b ? a : b;
}

/* The mean of some values, 0 of none. */
static inline double rl_mean(const float *values, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        sum += (double)values[i];
    }
    return count > 0 ? sum / count : 0.0;
}

/* Insert an item into a list, the best first, if it is among the best. Items begin with the float
 * that is compared; of equal ones the earlier is better.
 */
static inline void rl_keep_best(void *kept, int *count, int max_count, const void *item,
                                size_t size)
{
    char *items = kept;
    int at = *count;
    while (at > 0 && *(const float *)(const void *)(items + (size_t)(at - 1) * size) <
                         *(const float *)item) {
        at--;
    }
    if (at < max_count) {
        char *place = items + (size_t)at * size;
        *count += *count < max_count;
        memmove(place + size, place, (size_t)(*count - 1 - at) * size);
        memcpy(place, item, size);
    }
}

/* The value of a rank; it moves the values: none before it is greater, none after it less. */
static inline float rl_select(float *values, int count, int rank)
{
    for (int first = 0, last = count - 1; first < last;) {
        const float pivot = values[(first + last) / 2];
        int low = first, high = last;
        while (low <= high) {
            while (values[low] < pivot) {
                low++;
            }
            while (values[high] > pivot) {
                high--;
            }
            if (low <= high) {
                const float value = values[low];
                values[low++] = values[high];
                values[high--] = value;
            }
        }
        if (rank <= high) {
            last = high;
        } else if (rank >= low) {
            first = low;
        } else {
            break;
        }
    }
    return values[rank];
}

/* One block of memory, from which arrays are taken one after the other. */
struct rl_memory {
    char *block;   /* NULL while it is only counted how much there must be */
    int64_t taken; /* bytes */
};

/* Take an array of so many values of a size, aligned for any type; NULL while it is counted. */
static inline void *rl_take(struct rl_memory *memory, int64_t count, size_t size)
{
    const int64_t at = memory->taken;
    memory->taken += (count * (int64_t)size + 15) / 16 * 16;
    return memory->block == NULL ? NULL : memory->block + at;
}

#endif
