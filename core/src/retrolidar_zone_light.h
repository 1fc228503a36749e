/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What zones see of a marker whose light is known at every time: a level that wanders, and a gain,
 * by which the signal rises with the light.
 */
#ifndef RETROLIDAR_ZONE_LIGHT_H
#define RETROLIDAR_ZONE_LIGHT_H

#include "retrolidar_presence.h"
#include "retrolidar_samples.h"

struct rl_zone_light {
    double level, gain; /* [kcps/SPAD] */
    double level_variance, common, gain_variance;
};

/* A sample of a zone, less the light of other markers. */
struct rl_zone_sample {
    bool valid;
    double signal, variance; /* [kcps/SPAD] */
};

/* Fit level and gain to samples; `seen` is of so many of them, `light` that of the marker. */
struct rl_zone_light rl_zone_fit(const struct rl_zone_sample *samples, const double *light,
                                 int rows);

/* Let the fit be of a marker that has moved meanwhile, where the newest samples count. */
void rl_zone_doubt(struct rl_zone_light *lights, int zones);

/* The zone that sees most of a marker. */
int rl_zone_strongest(const struct rl_zone_light *lights, int zones);

/* Whether a zone is the same as another one or beside it. */
bool rl_zone_beside(int zone, int other, int columns);

/* Find by how much of its light a marker is seen, from the zones about the strongest. */
void rl_zone_measure(const struct rl_zone_light *lights, const struct rl_zone_sample *samples,
                     int zones, int columns, struct rl_glance *glance);

/* Let time pass. */
void rl_zone_predict(struct rl_zone_light *lights, int zones, double step_s);

/* Update all zones with their samples, in which the light is as predicted; return whether it is
 * shared otherwise than before.
 */
bool rl_zone_update(struct rl_zone_light *lights, const struct rl_zone_sample *samples, int zones,
                    int columns, double light);

#endif
