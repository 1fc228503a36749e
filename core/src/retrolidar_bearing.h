/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Direction of a marker within a zone, from the shares of its light in the zones around.
 *
 * Only light that is modulated by the marker's bits counts, so the background cancels. A spot is
 * mostly smaller than a zone: shares say much near edges and little in the middle. So the result is
 * the mean and the variance of all bearings, weighted by likelihood.
 */
#ifndef RETROLIDAR_BEARING_H
#define RETROLIDAR_BEARING_H

#include <stdint.h>

/* binding */
enum { RL_PLACES = 151, RL_BLURS = 7, RL_NEAR = 3 };

/* What does not depend on what was seen. */
struct rl_bearing_table {
    double place[RL_PLACES]; /* candidates, from the middle of a zone [widths of a zone] */
    double prior[RL_PLACES];
    double share[RL_BLURS][RL_PLACES][RL_NEAR]; /* of the light, in zones in a row */
};

/* Across and down, from the middle of a zone [widths of a zone]. */
struct rl_bearing {
    double mean[2], variance[2];
};

void rl_bearing_start(struct rl_bearing_table *table);

/* Find the bearing of a marker from its share in every zone, seen best by one of them.
 *
 * amplitude, variance: modulation of each zone by the marker [kcps/SPAD], and its variance
 *     [(kcps/SPAD)^2]
 * blur: of the optics, if it is known, else 0 [widths of a zone]
 */
struct rl_bearing rl_bearing_of(const struct rl_bearing_table *table, int32_t rows, int32_t columns,
                                int32_t zone, const double *amplitude, const double *variance,
                                double blur);
/* end of binding */

#endif
