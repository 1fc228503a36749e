/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Light and distance of a marker, without the background behind it and other markers beside it. */
#ifndef RETROLIDAR_RANGING_H
#define RETROLIDAR_RANGING_H

#include "retrolidar_constants.h"
#include "retrolidar_samples.h"

#include <stdbool.h>

/* Distance of a marker from the surface that it is mounted on. */
static const double RL_MOUNTING_M = 0.005;
/* Deviation of the acceleration of a range, such as of what passes at 0.5 m/s, 1 m away. */
static const double RL_BEND_M_S2 = 0.25;
/* No range is less, whatever the sensor's offset. */
static const double RL_NEAREST_M = 1e-3;

/* binding */
enum { RL_MAX_OTHERS = 2 }; /* markers beside one in a zone */

/* What one zone saw of a packet, sample by sample. */
struct rl_seen {
    const struct rl_sensor *sensor;
    int32_t rows;
    const double *begin_s, *end_s; /* of each exposure [s] */
    const double *light;           /* how bright the marker was, 0 to 1 */
    int32_t others;                /* other markers that are known to blink in the zone ... */
    double *other;                 /* ... and their light, overwritten, others * rows */
    double *orthogonal;            /* memory of rows: the part of the light orthogonal to theirs */
    const uint8_t *valid;
    const float *signal;   /* [kcps/SPAD] */
    const float *distance; /* along the optical axis [m], NaN where there was no target */
};

/* How far a marker was, along the optical axis, and when. */
struct rl_ranged {
    double depth_m, variance, time_s;
    double common; /* further variance, which the ranges of all zones share */
};

/* Find how far a marker is; false without distances. values, role: memory of `rows` each. */
bool rl_ranging(const struct rl_seen *seen, float *values, uint8_t *role, struct rl_ranged *ranged);
/* end of binding */

/* Fit of the light to the signal of each zone: gain, its variance, and the residual variance. */
struct rl_amplitude {
    double of[RL_MAX_ZONES], variance[RL_MAX_ZONES], noise[RL_MAX_ZONES];
    /* By the samples in which the packet is dark, as these do not show how its gain changes: the
     * gain's variance, and light that is not known, in the unit of the gain.
     */
    double dark_variance[RL_MAX_ZONES], unknown[RL_MAX_ZONES];
    double score[RL_MAX_ZONES]; /* correlation of the signal with the light */
};

/* Fit the light of a packet, and of others that are known, to the signal of a zone. */
void rl_fit_amplitude(const struct rl_samples *samples, const struct rl_seen *seen, int zone,
                      struct rl_amplitude *amplitude);

/* Whether the last of the others blinks in the valid samples. */
bool rl_last_other_is_seen(const struct rl_seen *seen);

/* Find the distance of the light that blinks in the samples that have a role, from a first guess;
 * false if none blinks. Then `orthogonal` is the residual over the gain [m].
 *
 * others: share of the signal that is light of other markers, 0 unless they are seen
 */
bool rl_blinking_range(const struct rl_seen *seen, const uint8_t *role, double about_m,
                       struct rl_ranged *found, double *others);

/* The probability that a surface at this squared distance from a marker is a background, anywhere
 * within `separable_m`, and not its mounting; spread: variance of a mounting's distance [m^2].
 */
double rl_chance_apart(double squared, double spread, double separable_m);

#endif
