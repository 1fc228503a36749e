/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Distance of a marker, without the background behind it.
 *
 * A target too near to the marker to be separated merges with it, and the distance reported is the
 * mean of both, weighted by signal. So signal times distance is a sum, of which the marker's part
 * is modulated and the background's is not: the modulation of signal times distance over that of
 * the signal is the distance of the marker alone.
 */
#ifndef RETROLIDAR_RANGING_H
#define RETROLIDAR_RANGING_H

#include "retrolidar_constants.h"
#include "retrolidar_sensor.h"

#include <stdbool.h>

/* binding */
/* What one zone saw of a packet, sample by sample. */
struct rl_seen {
    const struct rl_sensor *sensor;
    int32_t rows;
    const double *begin_s, *end_s; /* of each exposure [s] */
    const double *light;           /* how bright the marker was, 0 to 1 */
    const uint8_t *valid;
    const float *signal;   /* [kcps/SPAD] */
    const float *distance; /* along the optical axis [m], NaN where there was no target */
};

/* How far a marker was, along the optical axis, and when. */
struct rl_ranged {
    double depth_m, variance, time_s;
};

/* Find how far a marker is; false without distances.
 *
 * values, role: memory of `rows`
 */
bool rl_ranging(const struct rl_seen *seen, float *values, uint8_t *role, struct rl_ranged *ranged);
/* end of binding */

#endif
