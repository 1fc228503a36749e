/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_followed.h"

#include "retrolidar_noise.h"
#include "retrolidar_packet.h"
#include "retrolidar_ranging.h"

#include <math.h>
#include <string.h>

/* Deviation of a distance at a signal: a VL53L8CX has hypot(SHOT_M / signal, FLOOR_M). How many times
 * that variance a sensor has is learnt from frames that follow each other.
 */
static const double SHOT_M = 0.490, FLOOR_M = 0.0016;
static const double LEAST_SCALE = 0.25, MOST_SCALE = 16.0, LESSON = 0.02, MOST_LESSON = 9.0;
/* Of the clock of a reading: its start [s], its rate, and how they walk in a second. */
static const double START_S = 4e-3, RATE = 1.5e-3, WALK_S = 1e-4, RATE_WALK = 1e-4;
static const double EDGE_S = 2e-3; /* to either side, to find how light changes with the start */
static const double LIGHT_ERROR = 0.1;
/* Light is as predicted if it differs by less. */
static const double MAX_OFF = 0.35, MAX_DEVIATIONS = 3.0;
/* A nearer target hides the marker if it is so much nearer [m] and brighter. */
static const double NEARER_M = 0.1, BRIGHTER = 1.5;
static const double APART_M = 0.5; /* two targets, not one that is measured badly */
/* A zone measures the range if the marker is so much of its signal, and others are no more. */
static const double LEAST_OWN = 0.3, MOST_OTHER = 0.1;
static const double RANGED_LIGHT = 0.3; /* and if it has so much of its light */
static const double MOST_SPEED = 1.2;   /* of a marker that turned while it was dark [m/s] */
static const double GATE = 25.0; /* squared deviations */
static const int MOST_MISSES = 3;
static const double LEAST_SCALED = 0.2; /* so much of its light is the marker's */
static const double FIRST_M = 0.3; /* deviation of a range that is a guess */
/* What is behind is forgotten after so long, or after so much of a way. */
static const double BACKGROUND_S = 3.0, BACKGROUND_M = 0.05;
static const double MOUNTING_M = 0.005;
static const double BIAS_SHARE = 0.1, HIDDEN_SHARE = 0.3; /* of the newest frame */
/* The bearing is found anew after so many bright frames, or a change of gains. */
static const int BEARING_FRAMES = 8;
static const double BEARING_DEVIATIONS = 0.5, BEARING_SHARE = 0.01;
static const double SHARED_LIGHT = 0.5;
/* A marker that has crossed an edge goes on for so long. */
static const double CROSSED_S = 1.0;
static const double NEAREST_M = 1e-3;
static const double EXPONENT = -3.8; /* of the range, by which light falls (paper Fig. 5a) */

static double law_of(double signal)
{
    const double shot_m = SHOT_M / fmax(signal, 1e-3);
    return shot_m * shot_m + FLOOR_M * FLOOR_M;
}

void rl_followed_start(struct rl_followed *followed, const struct rl_reading *reading)
{
    memset(followed, 0, sizeof *followed);
    followed->id = reading->id;
    followed->sending = (struct rl_sending){rl_packet(reading->id), true, reading->start_s,
                                            reading->bit_s, reading->brightening_s};
    followed->clock = (struct rl_clock_error){START_S * START_S, 0.0, RATE * RATE};
    followed->noise_scale = 1.0;
    followed->distance_zone = -1;
    followed->bright_frames = BEARING_FRAMES;
}

static double now_of(const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    return (samples->begin_s[scenery->row] + samples->end_s[scenery->row]) / 2;
}

static double to_range(const struct rl_scenery *scenery, int zone, double depth_m)
{
    const struct rl_track_settings *settings = scenery->settings;
    return depth_m / settings->z_per_range[zone] - settings->range_offset_m;
}

static double distance_of(const struct rl_scenery *scenery, int zone)
{
    return (double)scenery->samples->distance[rl_sample(scenery->samples, zone, scenery->row)];
}

void rl_followed_place(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                       double depth_m)
{
    rl_range_start(&followed->range, fmax(to_range(scenery, zone, depth_m), NEAREST_M),
                   FIRST_M * FIRST_M);
    followed->ranged_s = now_of(scenery);
}

static void predict_light(struct rl_followed *followed, const struct rl_samples *samples, int row)
{
    struct rl_sending *sending = &followed->sending;
    const double packet_s = RL_PACKET_BITS * sending->bit_s;
    const double begin_s = samples->begin_s[row], end_s = samples->end_s[row];
    if (begin_s - sending->start_s > packet_s) {
        sending->start_s += packet_s * floor((begin_s - sending->start_s) / packet_s);
    }
    const double begins_s[] = {begin_s - EDGE_S, begin_s, begin_s + EDGE_S};
    const double ends_s[] = {end_s - EDGE_S, end_s, end_s + EDGE_S};
    double light[3];
    rl_template(sending, begins_s, ends_s, 3, light);
    followed->light = light[1];
    followed->slope = (light[0] - light[2]) / (2.0 * EDGE_S);
}

/* Light falls with the range, so gains follow it. */
static void follow_gains(struct rl_followed *followed, const struct rl_motion *before, int zones)
{
    const struct rl_motion now = rl_range_estimate(&followed->range);
    const double from_m = fmax(before->range_m, NEAREST_M), to_m = fmax(now.range_m, NEAREST_M);
    const double factor = pow(to_m / from_m, EXPONENT);
    const double more = fmax(now.variance - before->variance, 0.0);
    const double share = EXPONENT * EXPONENT * more / (to_m * to_m);
    for (int zone = 0; zone < zones; zone++) {
        struct rl_zone_light *one = &followed->zone[zone];
        one->gain *= factor;
        one->common *= factor;
        one->gain_variance *= factor * factor;
        one->gain_variance += share * one->gain * one->gain;
    }
}

/* Let time pass in the place, and in what zones see of it. */
static void move(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_motion before = rl_range_estimate(&followed->range);
    const double step_s = scenery->step_s;
    rl_range_predict(&followed->range, step_s);
    follow_gains(followed, &before, scenery->samples->zones);
    rl_zone_predict(followed->zone, scenery->samples->zones, step_s);
    followed->crossed *= exp(-step_s / CROSSED_S);
    const double rate = fabs(before.rate);
    const double kept = exp(-step_s * fmax(1.0 / BACKGROUND_S, rate / BACKGROUND_M));
    for (int zone = 0; zone < scenery->samples->zones; zone++) {
        followed->behind[zone].precision *= kept;
    }
}

void rl_followed_predict(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    struct rl_clock_error *clock = &followed->clock;
    const double step_s = scenery->step_s;
    clock->variance += step_s * (2.0 * clock->common + step_s * clock->rate_variance) +
                       WALK_S * WALK_S * step_s;
    clock->common += step_s * clock->rate_variance;
    clock->rate_variance += RATE_WALK * RATE_WALK * step_s;
    predict_light(followed, scenery->samples, scenery->row);
    move(followed, scenery);
}

struct rl_zone_sample rl_followed_sample(const struct rl_followed *followed,
                                         const struct rl_scenery *scenery, int zone)
{
    const struct rl_samples *samples = scenery->samples;
    const size_t at = rl_sample(samples, zone, scenery->row);
    const struct rl_zone_light *light = &followed->zone[zone];
    const double signal = (double)samples->signal[at];
    const double noise = samples->noise_scale * rl_noise_variance(samples, zone, signal);
    struct rl_zone_sample sample = {samples->valid[at] != 0, signal - scenery->other[zone],
                                    noise + scenery->other_variance[zone]};
    const double range_m = to_range(scenery, zone, (double)samples->distance[at]);
    if (!sample.valid || !isfinite(range_m)) {
        return sample;
    }
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double beyond_m = range_m - place.range_m;
    const double spread_m = 5.0 * sqrt(place.variance + followed->noise_scale * law_of(signal));
    /* A marker that has come nearer is brighter, too. */
    const double nearer = fmax(range_m, NEAREST_M) / fmax(place.range_m, NEAREST_M);
    const double usual = light->level + scenery->other[zone] +
                         followed->light * light->gain * pow(fmin(nearer, 1.0), EXPONENT);
    if (beyond_m > fmax(APART_M, spread_m)) {
        sample.signal = 0.0; /* a wall that the sensor separates: the marker is dimmer */
    } else if (beyond_m < -fmax(NEARER_M, spread_m) &&
               (signal > BRIGHTER * usual + 5.0 * sqrt(noise) ||
                beyond_m < -MOST_SPEED * (now_of(scenery) - followed->ranged_s) - 2.0 * NEARER_M)) {
        sample.valid = false;
    }
    return sample;
}

/* Where it is open whether what is behind a marker is its own mounting or farther, both are weighed
 * (`retrolidar_ranging.c`). Return by how far it is behind, times its chance to be so; its variance.
 */
static double behind_of(const struct rl_background *behind, double *chance, double *variance)
{
    const double mounting = MOUNTING_M * MOUNTING_M;
    *chance = 0.0;
    *variance = mounting;
    if (behind->precision <= 0.0 || fabs(behind->offset_m) > RL_SEPARABLE_M) {
        return 0.0;
    }
    const double noise = 1.0 / behind->precision, spread = noise + mounting;
    const double squared = behind->offset_m * behind->offset_m;
    const double mounted = exp(-squared / (2.0 * spread)) / sqrt(6.283185307179586 * spread);
    const double anywhere = 1.0 / (2.0 * RL_SEPARABLE_M);
    *chance = anywhere / (mounted + anywhere);
    *variance = (1.0 - *chance) * noise * mounting / spread + *chance * noise +
                *chance * (1.0 - *chance) * squared;
    return behind->offset_m;
}

static void see_behind(struct rl_followed *followed, int zone, double range_m, double signal)
{
    struct rl_background *behind = &followed->behind[zone];
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double off_m = range_m - place.range_m - behind->offset_m;
    const double precision = 1.0 / (followed->noise_scale * law_of(signal) + place.variance);
    behind->precision += precision;
    behind->offset_m += precision / behind->precision * off_m;
}

/* Learn how much distances vary, from two that follow each other. */
static void learn_noise(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                        double range_m, double variance)
{
    const double now_s = now_of(scenery), step_s = now_s - followed->distance_s;
    if (followed->distance_zone == zone && step_s < 1.5 * scenery->samples->period_s) {
        const struct rl_motion place = rl_range_estimate(&followed->range);
        const double off = range_m - followed->distance_m - place.rate * step_s;
        const double expected =
            variance + followed->distance_variance + place.rate_variance * step_s * step_s;
        const double surprise = fmin(off * off / expected, MOST_LESSON);
        followed->noise_scale *= 1.0 + LESSON * (surprise - 1.0);
        followed->noise_scale = fmin(fmax(followed->noise_scale, LEAST_SCALE), MOST_SCALE);
    }
    followed->distance_zone = zone;
    followed->distance_m = range_m;
    followed->distance_s = now_s;
    followed->distance_variance = variance;
}

/* When most of the light of an exposure came, after its middle: an edge may be within it. */
static double centre_of(const struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    const double dark_s = (1.0 - followed->light) *
                          (samples->end_s[scenery->row] - samples->begin_s[scenery->row]);
    return followed->slope > 0.0 ? -dark_s / 2 : followed->slope < 0.0 ? dark_s / 2 : 0.0;
}

static void measure_range(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                          double range_m, double signal)
{
    const struct rl_zone_light *light = &followed->zone[zone];
    const double late_s = centre_of(followed, scenery);
    const double share = fmin(fmax(light->level / fmax(signal, 1e-3), 0.0), 1.0 - LEAST_OWN);
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double variance =
        followed->noise_scale * law_of(signal) + place.rate_variance * late_s * late_s;
    double chance, offset_variance;
    const double offset_m = behind_of(&followed->behind[zone], &chance, &offset_variance);
    const double mixed = share * chance;
    const double own_m = (range_m - mixed * (offset_m + place.range_m)) / (1.0 - mixed) -
                         place.rate * late_s;
    const double off = own_m - place.range_m;
    /* It may have turned in the dark. */
    const double way_m = MOST_SPEED * (now_of(scenery) - followed->ranged_s);
    if (off * off > GATE * (place.variance + variance) + way_m * way_m) {
        if (++followed->misses > MOST_MISSES) {
            rl_range_start(&followed->range, own_m, 4.0 * variance);
            followed->misses = 0;
        }
        return;
    }
    followed->misses = 0;
    followed->ranged_s = now_of(scenery);
    if (zone == rl_zone_strongest(followed->zone, scenery->samples->zones)) {
        learn_noise(followed, scenery, zone, range_m, variance);
    }
    followed->bias_variance +=
        BIAS_SHARE * (share * share * offset_variance - followed->bias_variance);
    rl_range_update(&followed->range, own_m, variance, 1.0 - mixed);
}

static void update_range(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    const int strongest = rl_zone_strongest(followed->zone, samples->zones);
    for (int zone = 0; zone < samples->zones; zone++) {
        if (!rl_zone_beside(zone, strongest, samples->columns_of_zones)) {
            continue;
        }
        const struct rl_zone_light *light = &followed->zone[zone];
        const struct rl_zone_sample sample = rl_followed_sample(followed, scenery, zone);
        const double signal = (double)samples->signal[rl_sample(samples, zone, scenery->row)];
        const double range_m = to_range(scenery, zone, distance_of(scenery, zone));
        if (!sample.valid || !isfinite(range_m)) {
            continue;
        }
        if (followed->light > RANGED_LIGHT) {
            const double own = sample.signal - light->level;
            followed->hidden[zone] +=
                HIDDEN_SHARE * ((sample.signal == 0.0 ? signal : 0.0) - followed->hidden[zone]);
            if (own > LEAST_OWN * signal && own > 3.0 * sqrt(sample.variance) &&
                light->gain > 3.0 * sqrt(light->gain_variance) &&
                scenery->other[zone] < MOST_OTHER * signal) {
                measure_range(followed, scenery, zone, range_m, signal);
            }
        } else if (followed->light < RL_DARK && scenery->other[zone] < MOST_OTHER * signal) {
            see_behind(followed, zone, range_m, signal);
        }
    }
}

/* Correct the clock by what an edge within the exposure shows. */
static void update_clock(struct rl_followed *followed, const struct rl_scenery *scenery,
                         const struct rl_glance *glance)
{
    struct rl_clock_error *clock = &followed->clock;
    struct rl_sending *sending = &followed->sending;
    const double slope = followed->slope;
    const double noise = glance->variance + LIGHT_ERROR * LIGHT_ERROR;
    const double spread = slope * slope * clock->variance + noise;
    const double gain = slope * clock->variance / spread;
    const double rate_gain = slope * clock->common / spread;
    const double off = glance->measured - glance->light;
    clock->rate_variance -= rate_gain * slope * clock->common;
    clock->common -= gain * slope * clock->common;
    clock->variance -= gain * slope * clock->variance;
    const double since_s = scenery->samples->end_s[scenery->row] - sending->start_s;
    sending->start_s += gain * off - since_s * rate_gain * off;
    sending->bit_s *= 1.0 + rate_gain * off;
}

void rl_followed_bearing(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    const struct rl_track_settings *settings = scenery->settings;
    const int strongest = rl_zone_strongest(followed->zone, samples->zones);
    double amplitude[RL_MOST_ZONES], variance[RL_MOST_ZONES];
    const double most = followed->zone[strongest].gain;
    bool changed = strongest != followed->strongest || ++followed->bright_frames > BEARING_FRAMES;
    for (int zone = 0; zone < samples->zones; zone++) {
        amplitude[zone] = followed->zone[zone].gain;
        variance[zone] = followed->zone[zone].gain_variance +
                         followed->hidden[zone] * followed->hidden[zone];
        changed = changed || (rl_zone_beside(zone, strongest, samples->columns_of_zones) &&
                              fabs(amplitude[zone] - followed->amplitude[zone]) >
                                  BEARING_DEVIATIONS * sqrt(variance[zone]) + BEARING_SHARE * most);
    }
    if (!changed) {
        return;
    }
    const double range_m = fmax(rl_range_estimate(&followed->range).range_m, NEAREST_M);
    const double size_m = (double)settings->size_m[followed->id];
    variance[strongest] = 0.0;
    followed->crossed = strongest != followed->strongest ? 1.0 : followed->crossed;
    followed->strongest = strongest;
    followed->bright_frames = 0;
    memcpy(followed->amplitude, amplitude, sizeof amplitude);
    followed->bearing =
        rl_bearing_of(scenery->table, samples->rows_of_zones, samples->columns_of_zones, strongest,
                      amplitude, variance, size_m / settings->pitch / range_m, settings->blur);
}

/* Find the range, then the samples of all zones, of which it says which are the marker's. */
static void look(struct rl_followed *followed, const struct rl_scenery *scenery,
                 struct rl_zone_sample *sample)
{
    const struct rl_motion before = rl_range_estimate(&followed->range);
    update_range(followed, scenery);
    follow_gains(followed, &before, scenery->samples->zones);
    for (int zone = 0; zone < scenery->samples->zones; zone++) {
        sample[zone] = rl_followed_sample(followed, scenery, zone);
    }
}

/* How much light there is, and what that says of its presence. */
static struct rl_glance glimpse(struct rl_followed *followed, const struct rl_scenery *scenery,
                                const struct rl_zone_sample *sample, bool *crossed)
{
    const struct rl_samples *samples = scenery->samples;
    struct rl_glance glance = {
        .step_s = scenery->step_s,
        .bit_s = followed->sending.bit_s,
        .light = followed->light,
        .edge_variance = followed->slope * followed->slope * followed->clock.variance,
    };
    *crossed = rl_zone_measure(followed->zone, sample, samples->zones, samples->columns_of_zones,
                               &glance);
    if (rl_presence_update(&followed->presence, &glance)) {
        followed->last_ns = samples->stamp_ns[scenery->row];
    }
    return glance;
}

void rl_followed_replay(struct rl_followed *followed, const struct rl_scenery *scenery,
                        double light)
{
    const struct rl_samples *samples = scenery->samples;
    struct rl_zone_sample sample[RL_MOST_ZONES];
    bool crossed;
    followed->light = light;
    followed->slope = 0.0;
    move(followed, scenery);
    look(followed, scenery, sample);
    glimpse(followed, scenery, sample, &crossed);
    rl_zone_update(followed->zone, sample, samples->zones, samples->columns_of_zones, light,
                   crossed);
    followed->crossed = crossed ? 1.0 : followed->crossed;
}

/* Light that blinks as predicted, but by another amount, is a marker that has turned or moved. */
static void rescale(struct rl_followed *followed, int zones, const struct rl_glance *glance)
{
    if (!(followed->light > RL_BRIGHT) || !(glance->measured > LEAST_SCALED)) {
        return;
    }
    if (++followed->off_scale > MOST_MISSES) {
        for (int zone = 0; zone < zones; zone++) {
            followed->zone[zone].gain *= glance->measured;
            followed->zone[zone].common *= glance->measured;
            followed->zone[zone].gain_variance *= glance->measured * glance->measured;
        }
        followed->off_scale = 0;
    }
}

void rl_followed_update(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    struct rl_zone_sample sample[RL_MOST_ZONES];
    bool crossed;
    look(followed, scenery, sample);
    const struct rl_glance glance = glimpse(followed, scenery, sample, &crossed);
    const double off = fabs(glance.measured - glance.light);
    if (!isfinite(glance.variance) ||
        off > fmax(MAX_OFF, MAX_DEVIATIONS * sqrt(glance.variance + glance.edge_variance))) {
        rescale(followed, samples->zones, &glance);
        return;
    }
    followed->off_scale = followed->light > RL_BRIGHT ? 0 : followed->off_scale;
    update_clock(followed, scenery, &glance);
    rl_zone_update(followed->zone, sample, samples->zones, samples->columns_of_zones,
                   followed->light, crossed);
    followed->crossed = crossed ? 1.0 : followed->crossed;
    if (followed->light > SHARED_LIGHT) {
        followed->shared_s = now_of(scenery);
        rl_followed_bearing(followed, scenery);
    }
}
