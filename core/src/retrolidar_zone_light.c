/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_zone_light.h"

#include <math.h>
#include <stdlib.h>

/* Zones take part whose gain is above so many deviations and this share of the strongest's. */
static const double MIN_DEVIATIONS = 2.0, MIN_SHARE = 0.1;
/* By how much levels and gains change in a second, as a share of the gain. */
static const double LEVEL_WALK = 0.1, GAIN_WALK = 0.1, FLOOR_WALK = 0.3;
/* And by how much while a packet was read, as a share of the strongest gain. */
static const double MOVED_LEVEL = 0.1, MOVED_GAIN = 1.0;
/* Squared deviations at which a zone begins anew: the marker has crossed its edge. */
static const double MAX_SURPRISE = 9.0;
static const double BRIGHT_LIGHT = 0.5;

struct rl_zone_light rl_zone_fit(const struct rl_zone_sample *samples, const double *light,
                                 int rows)
{
    double weight = 1e-12, mean = 0.0, signal = 0.0, energy = 1e-12, cross = 0.0, power = 0.0;
    double count = 0.0;
    for (int row = 0; row < rows; row++) {
        const double precision = samples[row].valid ? 1.0 / samples[row].variance : 0.0;
        weight += precision;
        mean += precision * light[row];
        signal += precision * samples[row].signal;
        count += samples[row].valid;
    }
    mean /= weight;
    signal /= weight;
    for (int row = 0; row < rows; row++) {
        const double precision = samples[row].valid ? 1.0 / samples[row].variance : 0.0;
        energy += precision * (light[row] - mean) * (light[row] - mean);
        cross += precision * (light[row] - mean) * (samples[row].signal - signal);
    }
    const double gain = cross / energy;
    for (int row = 0; row < rows; row++) {
        const double left = samples[row].signal - signal - gain * (light[row] - mean);
        power += samples[row].valid ? left * left / samples[row].variance : 0.0;
    }
    const double scale = fmax(power / fmax(count - 2.0, 1.0), 1.0);
    return (struct rl_zone_light){
        .level = signal - gain * mean,
        .gain = gain,
        .level_variance = scale * (1.0 / weight + mean * mean / energy),
        .common = -scale * mean / energy,
        .gain_variance = scale / energy,
    };
}

void rl_zone_doubt(struct rl_zone_light *lights, int zones)
{
    const double most = fmax(lights[rl_zone_strongest(lights, zones)].gain, 0.0);
    for (int zone = 0; zone < zones; zone++) {
        lights[zone].level_variance += MOVED_LEVEL * MOVED_LEVEL * most * most;
        lights[zone].gain_variance += MOVED_GAIN * MOVED_GAIN * most * most;
    }
}

int rl_zone_strongest(const struct rl_zone_light *lights, int zones)
{
    int strongest = 0;
    for (int zone = 1; zone < zones; zone++) {
        strongest = lights[zone].gain > lights[strongest].gain ? zone : strongest;
    }
    return strongest;
}

bool rl_zone_beside(int zone, int other, int columns)
{
    return abs(zone / columns - other / columns) <= 1 && abs(zone % columns - other % columns) <= 1;
}

void rl_zone_measure(const struct rl_zone_light *lights, const struct rl_zone_sample *samples,
                     int zones, int columns, struct rl_glance *glance)
{
    const int strongest = rl_zone_strongest(lights, zones);
    double cross = 0.0, energy = 0.0, total = 0.0, gain = 0.0, variance = 0.0;
    for (int zone = 0; zone < zones; zone++) {
        const struct rl_zone_light *one = &lights[zone];
        if (!samples[zone].valid || !rl_zone_beside(zone, strongest, columns)) {
            continue;
        }
        const double noise = samples[zone].variance + one->level_variance;
        const double rise = samples[zone].signal - one->level;
        total += rise;
        gain += fmax(one->gain, 0.0);
        variance += noise;
        if (one->gain > MIN_SHARE * lights[strongest].gain &&
            one->gain > MIN_DEVIATIONS * sqrt(one->gain_variance)) {
            cross += one->gain * rise / noise;
            energy += one->gain * one->gain / noise;
        }
    }
    glance->measured = 0.0;
    glance->variance = INFINITY;
    if (!(energy > 0.0)) {
        return;
    }
    glance->measured = cross / energy;
    glance->variance = 1.0 / energy;
    /* A marker that has crossed an edge is seen by another zone than before. */
    const double all = total / gain;
    if (fabs(all - glance->light) < fabs(glance->measured - glance->light) &&
        fabs(glance->measured - glance->light) > 3.0 * sqrt(glance->variance)) {
        glance->measured = all;
        glance->variance = variance / (gain * gain);
    }
}

void rl_zone_predict(struct rl_zone_light *lights, int zones, double step_s)
{
    const double most = fmax(lights[rl_zone_strongest(lights, zones)].gain, 0.0);
    for (int zone = 0; zone < zones; zone++) {
        const double level = FLOOR_WALK + LEVEL_WALK * fmax(lights[zone].level, 0.0);
        const double gain = GAIN_WALK * fmax(lights[zone].gain, 0.1 * most);
        lights[zone].level_variance += level * level * step_s;
        lights[zone].gain_variance += gain * gain * step_s;
    }
}

bool rl_zone_update(struct rl_zone_light *lights, const struct rl_zone_sample *samples, int zones,
                    int columns, double light)
{
    const int strongest = rl_zone_strongest(lights, zones);
    bool shared = false;
    for (int zone = 0; zone < zones; zone++) {
        struct rl_zone_light *one = &lights[zone];
        if (!samples[zone].valid) {
            continue;
        }
        const double off = samples[zone].signal - one->level - light * one->gain;
        double level = one->level_variance + light * one->common;
        double gain = one->common + light * one->gain_variance;
        double spread = level + light * gain + samples[zone].variance;
        if (off * off > MAX_SURPRISE * spread) {
            if (light < BRIGHT_LIGHT) {
                one->level_variance += off * off;
            } else if (rl_zone_beside(zone, strongest, columns)) {
                one->gain_variance += off * off / (light * light);
                shared = true;
            }
            level = one->level_variance + light * one->common;
            gain = one->common + light * one->gain_variance;
            spread = level + light * gain + samples[zone].variance;
        }
        one->level += level / spread * off;
        one->gain += gain / spread * off;
        one->level_variance -= level / spread * level;
        one->common -= level / spread * gain;
        one->gain_variance -= gain / spread * gain;
    }
    return shared;
}
