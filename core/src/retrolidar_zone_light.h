/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What zones see of a marker whose light is known at every time: a level that wanders, and a gain,
 * by which the signal rises with the light.
 */
#ifndef RETROLIDAR_ZONE_LIGHT_H
#define RETROLIDAR_ZONE_LIGHT_H

#include "retrolidar_detector.h"
#include "retrolidar_presence.h"
#include "retrolidar_samples.h"

struct rl_zone_light {
    double level, gain; /* [kcps/SPAD] */
    double level_variance, common, gain_variance;
    double excess; /* variance of what is left over, over that of noise: of other light */
    double raised_bits; /* for so long its dark bits are brighter than its level */
};

/* A sample of a zone, less the light of other markers. */
struct rl_zone_sample {
    bool valid;
    double signal, variance; /* [kcps/SPAD] */
};

/* Weighted sums of light and signal, to which level and gain are fitted. */
struct rl_zone_sums {
    double count, weight, light, signal, squares, cross, power;
};

void rl_zone_add(struct rl_zone_sums *sums, const struct rl_zone_sample *sample, double light);
struct rl_zone_light rl_zone_fit(const struct rl_zone_sums *sums);

/* Let the fits be of a marker that may have moved meanwhile, so the newest samples count. Zones
 * that have not read it see nothing of it: what fits there is the light of another.
 */
void rl_zone_doubt(struct rl_zone_light *lights, int zones, const struct rl_reading *reading);

/* The zone that sees most of a marker. */
int rl_zone_strongest(const struct rl_zone_light *lights, int zones);

/* Whether a zone is sure to see a part of the marker that the strongest zone sees. */
bool rl_zone_sees(const struct rl_zone_light *lights, int zone, int strongest);

/* Find by how much of its light a marker is seen, from the zones about the strongest. Return
 * whether that is shared otherwise than before: it has crossed an edge.
 */
bool rl_zone_measure(const struct rl_zone_light *lights, const struct rl_zone_sample *samples,
                     int zones, int columns, struct rl_glance *glance);

/* Let time pass. crossed: the chance that the marker crosses the view */
void rl_zone_predict(struct rl_zone_light *lights, int zones, int columns, double step_s,
                     double crossed);

/* Update all zones with samples in which the light is as predicted, shared otherwise or not. */
void rl_zone_update(struct rl_zone_light *lights, const struct rl_zone_sample *samples, int zones,
                    int columns, const struct rl_glance *glance, bool crossed);

#endif
