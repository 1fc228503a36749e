/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Minimum and maximum that compile to an instruction: unlike fmin and fmax, a NaN may come through. */
#ifndef RETROLIDAR_MATH_H
#define RETROLIDAR_MATH_H

static inline float rl_minf(float a, float b)
{
    return a < b ? a : b;
}

static inline float rl_maxf(float a, float b)
{
    return a > b ? a : b;
}

#endif
