/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Arithmetic on RL_LANES channels at once. It has its own file because compilers vectorise these
 * loops only as long as nothing is around them.
 */
#include "retrolidar_view.h"

/* Weight of an erasure: not 0, so that the level is defined where all is erased. */
static const float ERASED = 1e-3f;

void rl_lanes_eliminate(float stiff, float ends, const float *restrict known,
                        const float *restrict value, const float *restrict light_before,
                        const float *restrict pivot_before, float *restrict light,
                        float *restrict pivot)
{
    for (int lane = 0; lane < RL_LANES; lane++) {
        const float weight = known[lane] > 0.0f ? 1.0f : ERASED;
        const float scale = 1.0f / (weight + ends - stiff * pivot_before[lane]);
        light[lane] = (weight * value[lane] + stiff * light_before[lane]) * scale;
        pivot[lane] = stiff * scale;
    }
}

void rl_lanes_substitute(const float *restrict level_after, const float *restrict total_after,
                         const float *restrict power_after, const float *restrict valid_after,
                         float *restrict pivot, float *restrict light, float *restrict total,
                         float *restrict power, float *restrict valid)
{
    for (int lane = 0; lane < RL_LANES; lane++) {
        const float level = light[lane] + pivot[lane] * level_after[lane];
        const float left = (power[lane] - level) * valid[lane];
        pivot[lane] = level;
        light[lane] = left;
        total[lane] = total_after[lane] - left;
        power[lane] = power_after[lane] - left * power[lane];
        valid[lane] = valid_after[lane] - valid[lane];
    }
}

void rl_lanes_integrate_and_dump(float share, const float *restrict total,
                                 const float *restrict light, const float *restrict before,
                                 float *restrict until, float *restrict soft)
{
    for (int lane = 0; lane < RL_LANES; lane++) {
        until[lane] = total[lane] + share * light[lane];
        soft[lane] += before[lane] - until[lane];
    }
}

void rl_lanes_summarise(const float *restrict soft, uint32_t bit, float *restrict any,
                        float *restrict squares, uint32_t *restrict dark)
{
    for (int lane = 0; lane < RL_LANES; lane++) {
        any[lane] += rl_maxf(0.0f, soft[lane]);
        squares[lane] += soft[lane] * soft[lane];
        dark[lane] |= bit & (0u - (uint32_t)(soft[lane] > 0.0f));
    }
}
