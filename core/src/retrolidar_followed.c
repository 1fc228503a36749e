/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_followed.h"

#include "retrolidar_packet.h"
#include "retrolidar_ranging.h"

#include <math.h>
#include <string.h>

/* Deviations of a reading's clock: its start [s] and rate, and their random walks in a second. */
static const double START_S = 4e-3, RATE = 1.5e-3, WALK_S = 1e-4, RATE_WALK = 1e-4;
static const double FIRST_M = 0.3; /* the same of its range, as it may move meanwhile */
static const double EDGE_S = 2e-3; /* half the step of the light's derivative by the start */
static const double LIGHT_ERROR = 0.1;
/* Light is as predicted if it differs by less. */
static const double MAX_OFF = 0.6, MAX_DEVIATIONS = 3.0;
static const int MAX_OFF_SCALE = 3;   /* bright frames */
static const double MIN_SCALED = 0.2; /* a frame with less light is not one of another gain */
/* The background is forgotten as the marker moves so far. */
static const double BACKGROUND_M = 0.05;
/* The bearing is found anew after so many bright frames, or a change of gains. */
static const int BEARING_FRAMES = 24;
static const double BEARING_DEVIATIONS = 0.5, BEARING_SHARE = 0.01;
static const double SHARED_LIGHT = 0.5;
/* A marker that has crossed an edge keeps moving for so long. */
static const double CROSSED_S = 1.0;
static const double LOST_BITS = 5.0; /* a marker that was not seen in these is lost */

void rl_followed_start(struct rl_followed *followed, const struct rl_reading *reading)
{
    const struct rl_verdict *verdict = &reading->verdict;
    memset(followed, 0, sizeof *followed);
    followed->id = verdict->id;
    followed->transmission = verdict->transmission;
    followed->transmission.repeats = true;
    followed->first_s = verdict->transmission.start_s;
    rl_range_start(&followed->range, fmax(reading->placement.range_m, RL_NEAREST_M),
                   FIRST_M * FIRST_M);
    followed->ranged_s = verdict->begin_s;
    followed->clock = (struct rl_clock_error){START_S * START_S, 0.0, RATE * RATE};
    followed->noise_scale = 1.0;
    followed->distance_zone = -1;
    followed->strongest = reading->zone[0];
    followed->bright_frames = BEARING_FRAMES;
}

double rl_followed_lost(const struct rl_followed *followed)
{
    return fmin(followed->presence.unseen_bits / LOST_BITS, 1.0);
}

static void predict_light(struct rl_followed *followed, const struct rl_samples *samples, int row)
{
    struct rl_transmission *transmission = &followed->transmission;
    const double begin_s = samples->begin_s[row], end_s = samples->end_s[row];
    transmission->start_s = fmax(transmission->start_s, rl_last_start(transmission, begin_s));
    const double begins_s[] = {begin_s - EDGE_S, begin_s, begin_s + EDGE_S};
    const double ends_s[] = {end_s - EDGE_S, end_s, end_s + EDGE_S};
    double light[3];
    rl_template(transmission, begins_s, ends_s, 3, light);
    followed->light = light[1];
    followed->slope = (light[0] - light[2]) / (2.0 * EDGE_S);
}

/* Light falls with the range, so gains follow it. */
static void follow_gains(struct rl_followed *followed, const struct rl_motion *before, int zones)
{
    const struct rl_motion now = rl_range_estimate(&followed->range);
    const double from_m = fmax(before->range_m, RL_NEAREST_M);
    const double to_m = fmax(now.range_m, RL_NEAREST_M);
    const double factor = pow(to_m / from_m, RL_EXPONENT);
    const double more = fmax(now.variance - before->variance, 0.0);
    const double share = RL_EXPONENT * RL_EXPONENT * more / (to_m * to_m);
    for (int zone = 0; zone < zones; zone++) {
        struct rl_zone_light *one = &followed->zone[zone];
        one->gain *= factor;
        one->common *= factor;
        one->gain_variance *= factor * factor;
        one->gain_variance += share * one->gain * one->gain;
    }
}

/* Predict the range, and the light of all zones. */
static void move(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_motion before = rl_range_estimate(&followed->range);
    const double step_s = scenery->step_s;
    rl_range_predict(&followed->range, step_s);
    follow_gains(followed, &before, scenery->samples->zones);
    rl_zone_predict(followed->zone, scenery->samples,
                    rl_followed_strongest(followed, scenery->samples), step_s, followed->crossed);
    followed->crossed *= exp(-step_s / CROSSED_S);
    const double rate = fabs(before.rate);
    const double kept = exp(-step_s * rate / BACKGROUND_M);
    for (int zone = 0; zone < scenery->samples->zones; zone++) {
        followed->behind[zone].precision *= kept;
    }
}

void rl_followed_predict(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    struct rl_clock_error *clock = &followed->clock;
    const double step_s = scenery->step_s;
    clock->variance +=
        step_s * (2.0 * clock->common + step_s * clock->rate_variance) + WALK_S * WALK_S * step_s;
    clock->common += step_s * clock->rate_variance;
    clock->rate_variance += RATE_WALK * RATE_WALK * step_s;
    predict_light(followed, scenery->samples, scenery->row);
    move(followed, scenery);
}

/* Correct the clock by an edge within the exposure. */
static void update_clock(struct rl_followed *followed, const struct rl_scenery *scenery,
                         const struct rl_glance *glance)
{
    struct rl_clock_error *clock = &followed->clock;
    struct rl_transmission *transmission = &followed->transmission;
    const double slope = followed->slope;
    const double noise = glance->variance + LIGHT_ERROR * LIGHT_ERROR;
    const double spread = slope * slope * clock->variance + noise;
    const double gain = slope * clock->variance / spread;
    const double rate_gain = slope * clock->common / spread;
    const double off = glance->measured - glance->light;
    clock->rate_variance -= rate_gain * slope * clock->common;
    clock->common -= gain * slope * clock->common;
    clock->variance -= gain * slope * clock->variance;
    const double since_s = scenery->samples->end_s[scenery->row] - transmission->start_s;
    transmission->start_s += gain * off - since_s * rate_gain * off;
    transmission->bit_s *= 1.0 + rate_gain * off;
}

void rl_followed_bearing(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    const int strongest = rl_followed_strongest(followed, samples);
    double amplitude[RL_MAX_ZONES], variance[RL_MAX_ZONES];
    const double most = followed->zone[strongest].gain;
    bool changed = strongest != followed->strongest || ++followed->bright_frames > BEARING_FRAMES;
    for (int zone = 0; zone < samples->zones; zone++) {
        amplitude[zone] = followed->zone[zone].gain;
        variance[zone] = followed->zone[zone].gain_variance;
        changed = changed || (rl_zone_beside(zone, strongest, samples->sensor.columns) &&
                              fabs(amplitude[zone] - followed->amplitude[zone]) >
                                  BEARING_DEVIATIONS * sqrt(variance[zone]) + BEARING_SHARE * most);
    }
    if (!changed) {
        return;
    }
    variance[strongest] = 0.0;
    followed->crossed = strongest != followed->strongest ? 1.0 : followed->crossed;
    followed->strongest = strongest;
    followed->bright_frames = 0;
    memcpy(followed->amplitude, amplitude, sizeof amplitude);
    followed->bearing = rl_bearing_of(scenery->table, samples->sensor.rows,
                                      samples->sensor.columns, strongest, amplitude, variance,
                                      scenery->samples->sensor.zone_blur);
}

/* Update the range, choose the samples that are the marker's by it, measure the light, and update
 * the presence.
 */
static struct rl_glance observe(struct rl_followed *followed, const struct rl_scenery *scenery,
                                struct rl_zone_sample *sample)
{
    const struct rl_samples *samples = scenery->samples;
    const struct rl_motion before = rl_range_estimate(&followed->range);
    rl_followed_range(followed, scenery);
    follow_gains(followed, &before, samples->zones);
    for (int zone = 0; zone < samples->zones; zone++) {
        sample[zone] = rl_followed_sample(followed, scenery, zone);
    }
    struct rl_glance glance = {
        .step_s = scenery->step_s,
        .bit_s = followed->transmission.bit_s,
        .light = followed->light,
        .edge_variance = followed->slope * followed->slope * followed->clock.variance,
    };
    rl_zone_measure(followed->zone, samples, sample, rl_followed_strongest(followed, samples),
                    &glance);
    if (rl_presence_update(&followed->presence, &glance)) {
        followed->last_ns = samples->stamp_ns[scenery->row];
    }
    return glance;
}

/* Update the light of all zones by what was observed. */
static void update_zones(struct rl_followed *followed, const struct rl_samples *samples,
                         const struct rl_zone_sample *sample, const struct rl_glance *glance)
{
    rl_zone_update(followed->zone, samples, sample, rl_followed_strongest(followed, samples),
                   glance);
    followed->crossed = glance->crossed ? 1.0 : followed->crossed;
}

void rl_followed_replay(struct rl_followed *followed, const struct rl_scenery *scenery,
                        double light)
{
    struct rl_zone_sample sample[RL_MAX_ZONES];
    followed->light = light;
    followed->slope = 0.0;
    move(followed, scenery);
    const struct rl_glance glance = observe(followed, scenery, sample);
    update_zones(followed, scenery->samples, sample, &glance);
    if (light > SHARED_LIGHT) {
        followed->strongest = rl_followed_strongest(followed, scenery->samples);
    }
}

/* If the light blinks as predicted, but by another amount, the marker has turned or moved. */
static void rescale(struct rl_followed *followed, int zones, const struct rl_glance *glance)
{
    if (!(followed->light > RL_BRIGHT) || !(glance->measured > MIN_SCALED)) {
        return;
    }
    if (++followed->off_scale > MAX_OFF_SCALE) {
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
    struct rl_zone_sample sample[RL_MAX_ZONES];
    const struct rl_glance glance = observe(followed, scenery, sample);
    const double off = fabs(glance.measured - glance.light);
    if (!isfinite(glance.variance) ||
        off > fmax(MAX_OFF, MAX_DEVIATIONS * sqrt(glance.variance + glance.edge_variance))) {
        rescale(followed, samples->zones, &glance);
        return;
    }
    followed->off_scale = followed->light > RL_BRIGHT ? 0 : followed->off_scale;
    update_clock(followed, scenery, &glance);
    update_zones(followed, samples, sample, &glance);
    if (followed->light > SHARED_LIGHT) {
        followed->shared_s = rl_scenery_now(scenery);
        rl_followed_bearing(followed, scenery);
    }
}
