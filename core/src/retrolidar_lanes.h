/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Arithmetic on channels side by side, RL_LANES of them; in a file of its own, as compilers make
 * vectors of these loops as long as nothing is around them.
 */
#ifndef RETROLIDAR_LANES_H
#define RETROLIDAR_LANES_H

#include <stdint.h>

enum { RL_LANES = 16 };

/* One step of the elimination: rows from the first on. */
void rl_lanes_eliminate(float stiff, float ends, const float *restrict known,
                        const float *restrict value, const float *restrict light_before,
                        const float *restrict pivot_before, float *restrict light,
                        float *restrict pivot);

/* One step of the substitution, rows from the last on: what the elimination has left becomes the
 * level, and the level what is left of the samples. Sums are of the rows from this one on,
 * negative.
 */
void rl_lanes_substitute(const float *restrict level_after, const float *restrict total_after,
                         const float *restrict power_after, const float *restrict valid_after,
                         float *restrict pivot, float *restrict light, float *restrict total,
                         float *restrict power, float *restrict valid);

/* Light of some lanes until an edge, and what a bit has lost since the edge before. */
void rl_lanes_integrate_and_dump(float share, const float *restrict total,
                                 const float *restrict light, const float *restrict before,
                                 float *restrict until, float *restrict soft);

void rl_lanes_summarise(const float *restrict soft, uint32_t bit, float *restrict any,
                        float *restrict squares, uint32_t *restrict dark);

#endif
