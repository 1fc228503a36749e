/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What <math.h> lacks. */
#ifndef RETROLIDAR_MATH_H
#define RETROLIDAR_MATH_H

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

/* The value of a rank among some, which it moves: none before it is greater, none after it less. */
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

/* The middle one of some values, which it sorts; the upper one of two. */
static inline double rl_median(double *values, int count)
{
    for (int i = 1; i < count; i++) {
        const double value = values[i];
        int j = i;
        for (; j > 0 && values[j - 1] > value; j--) {
            values[j] = values[j - 1];
        }
        values[j] = value;
    }
    return values[count / 2];
}

#endif
