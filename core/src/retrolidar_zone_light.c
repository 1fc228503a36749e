/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What zones see of a marker whose light is known: a level that wanders, and a gain. */
#include "retrolidar_followed.h"

#include <math.h>

/* Zones take part whose gain is above so many deviations and this share of the strongest's. */
static const double MIN_DEVIATIONS = 4.0, MIN_SHARE = 0.1;
/* Random walk in a second: shares of level and gain, and of any level [kcps/SPAD]. */
static const double LEVEL_WALK = 0.1, GAIN_WALK = 0.3, FLOOR_WALK = 0.3;
/* Walk of the gains of a marker that crosses the view, as a share of the strongest. */
static const double CROSSED_WALK = 1.0;
/* Deviations after a packet was read, as a share of the strongest gain. */
static const double MOVED_LEVEL = 0.1, MOVED_GAIN = 1.0, UNREAD_GAIN = 0.05;
/* Squared deviations at which a zone begins anew: the marker has crossed its edge. */
static const double MAX_SURPRISE = 9.0;
/* How fast the excess variance is learnt, and its largest value. */
static const double EXCESS_SHARE = 0.1, MAX_EXCESS = 1e4;
static const double BRIGHT_LIGHT = 0.5, WHOLE_LIGHT = 0.9;

void rl_zone_add(struct rl_zone_sums *sums, const struct rl_zone_sample *sample, double light)
{
    const double weight = sample->valid ? 1.0 / sample->variance : 0.0;
    sums->count += sample->valid;
    sums->weight += weight;
    sums->light += weight * light;
    sums->signal += weight * sample->signal;
    sums->squares += weight * light * light;
    sums->cross += weight * light * sample->signal;
    sums->power += weight * sample->signal * sample->signal;
}

struct rl_zone_light rl_zone_fit(const struct rl_zone_sums *sums)
{
    const double weight = fmax(sums->weight, 1e-12);
    const double mean = sums->light / weight, signal = sums->signal / weight;
    const double energy = fmax(sums->squares - weight * mean * mean, 1e-12);
    const double cross = sums->cross - weight * mean * signal, gain = cross / energy;
    const double left = sums->power - weight * signal * signal - gain * cross;
    const double excess = fmax(left / fmax(sums->count - 2.0, 1.0), 1.0);
    return (struct rl_zone_light){
        .level = signal - gain * mean,
        .gain = gain,
        .level_variance = excess * (1.0 / weight + mean * mean / energy),
        .common = -excess * mean / energy,
        .gain_variance = excess / energy,
        .excess = excess,
    };
}

void rl_zone_doubt(struct rl_zone_light *lights, int zones, const struct rl_reading *reading)
{
    bool has_read[RL_MAX_ZONES] = {false};
    double most = 0.0;
    for (int i = 0; i < reading->zones; i++) {
        has_read[reading->zone[i]] = true;
        most = fmax(most, lights[reading->zone[i]].gain);
    }
    for (int zone = 0; zone < zones; zone++) {
        struct rl_zone_light *one = &lights[zone];
        if (has_read[zone]) {
            one->level_variance += MOVED_LEVEL * MOVED_LEVEL * most * most;
            one->gain_variance += MOVED_GAIN * MOVED_GAIN * most * most;
        } else {
            one->level += one->gain / 2;
            one->gain = one->common = 0.0;
            one->level_variance += UNREAD_GAIN * UNREAD_GAIN * most * most;
            one->gain_variance = UNREAD_GAIN * UNREAD_GAIN * most * most;
        }
    }
}

int rl_zone_strongest(const struct rl_zone_light *lights, const struct rl_samples *held, int near)
{
    int strongest = near;
    for (int zone = 0; zone < held->zones; zone++) {
        if (lights[zone].gain > lights[strongest].gain &&
            rl_zone_beside(zone, near, held->sensor.columns)) {
            strongest = zone;
        }
    }
    return strongest;
}

bool rl_zone_sees(const struct rl_zone_light *lights, const struct rl_samples *held, int zone,
                  int strongest)
{
    const struct rl_zone_light *one = &lights[zone];
    return zone == strongest ? one->gain > 0.0
                             : one->gain > MIN_SHARE * lights[strongest].gain &&
                                   one->gain > MIN_DEVIATIONS * sqrt(one->gain_variance) &&
                                   rl_zone_beside(zone, strongest, held->sensor.columns);
}

void rl_zone_measure(const struct rl_zone_light *lights, const struct rl_samples *held,
                     const struct rl_zone_sample *samples, int strongest,
                     struct rl_glance *glance)
{
    double cross = 0.0, energy = 0.0, total = 0.0, gain = 0.0, variance = 0.0;
    for (int zone = 0; zone < held->zones; zone++) {
        const struct rl_zone_light *one = &lights[zone];
        if (!samples[zone].valid || !rl_zone_beside(zone, strongest, held->sensor.columns)) {
            continue;
        }
        const double noise = one->excess * samples[zone].variance + one->level_variance;
        const double rise = samples[zone].signal - one->level;
        total += rise;
        gain += fmax(one->gain, 0.0);
        variance += noise;
        if (rl_zone_sees(lights, held, zone, strongest)) {
            cross += one->gain * rise / noise;
            energy += one->gain * one->gain / noise;
        }
    }
    glance->measured = 0.0;
    glance->variance = INFINITY;
    if (!(energy > 0.0)) {
        return;
    }
    glance->level = fmax(lights[strongest].level, 0.0) / lights[strongest].gain;
    glance->measured = cross / energy;
    glance->variance = 1.0 / energy;
    /* A marker that has crossed an edge is seen by another zone than before. */
    const double all = total / gain;
    const double lost = glance->light - glance->measured;
    if (glance->light > BRIGHT_LIGHT && fabs(all - glance->light) < lost &&
        lost * lost > MAX_SURPRISE * glance->variance) {
        glance->measured = all;
        glance->variance = variance / (gain * gain);
        glance->crossed = true;
    }
}

void rl_zone_predict(struct rl_zone_light *lights, const struct rl_samples *held, int strongest,
                     double step_s, double crossed)
{
    const double most = fmax(lights[strongest].gain, 0.0);
    for (int zone = 0; zone < held->zones; zone++) {
        const bool is_beside = rl_zone_beside(zone, strongest, held->sensor.columns);
        const double level = FLOOR_WALK + LEVEL_WALK * fmax(lights[zone].level, 0.0);
        const double gain = GAIN_WALK * fmax(lights[zone].gain, 0.1 * most);
        const double won = is_beside ? CROSSED_WALK * crossed * most : 0.0;
        lights[zone].level_variance += level * level * step_s;
        lights[zone].gain_variance += (gain * gain + won * won) * step_s;
    }
}

void rl_zone_update(struct rl_zone_light *lights, const struct rl_samples *held,
                    const struct rl_zone_sample *samples, int strongest,
                    const struct rl_glance *glance)
{
    const double light = glance->light;
    for (int zone = 0; zone < held->zones; zone++) {
        struct rl_zone_light *one = &lights[zone];
        if (!samples[zone].valid) {
            continue;
        }
        const double noise = samples[zone].variance + one->gain * one->gain * glance->edge_variance;
        const double off = samples[zone].signal - one->level - light * one->gain;
        double level = one->level_variance + light * one->common;
        double gain = one->common + light * one->gain_variance;
        double spread = level + light * gain + noise;
        const double surprise = off * off / spread;
        const bool is_shared =
            glance->crossed && rl_zone_beside(zone, strongest, held->sensor.columns);
        if (surprise > MAX_SURPRISE && light > BRIGHT_LIGHT &&
            (is_shared || (zone == strongest && light > WHOLE_LIGHT))) {
            one->gain_variance += off * off / (light * light);
            one->excess = 1.0;
        } else {
            /* Light of another marker, maybe, which is no share of this one's. */
            one->excess += EXCESS_SHARE * (fmin(surprise, MAX_EXCESS) - one->excess);
            one->excess = fmax(one->excess, 1.0);
        }
        level = one->level_variance + light * one->common;
        gain = one->common + light * one->gain_variance;
        spread = level + light * gain + one->excess * noise;
        one->level += level / spread * off;
        one->gain += gain / spread * off;
        one->level_variance -= level / spread * level;
        one->common -= level / spread * gain;
        one->gain_variance -= gain / spread * gain;
    }
}
