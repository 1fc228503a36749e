/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The range of a marker that is followed, and the choice of samples that are its own. */
#include "retrolidar_followed.h"

#include "retrolidar_ranging.h"

#include <math.h>

/* The noise of ranges, relative to the law, is learnt from successive frames. */
static const double MIN_SCALE = 0.25, MAX_SCALE = 16.0, LESSON = 0.02, MAX_LESSON = 9.0;
/* A nearer target hides the marker if it is so much nearer [m] and brighter. */
static const double NEARER_M = 0.1, BRIGHTER = 1.5;
/* The zone measures the range if so much of its signal is the marker's, and less is others'. */
static const double MIN_OWN = 0.3, MAX_OTHER = 0.1, RANGED_LIGHT = 0.1;
static const double MAX_CHANGE = 1.2; /* of the rate while it was dark [m/s] */
static const double GATE = 25.0;      /* squared deviations */
/* Distance of unknown light from the marker. */
static const double UNKNOWN_M = 0.4;
static const double MIN_BEHIND = 0.5;    /* least share of the background in a signal */
static const double MIN_PRECISION = 0.1; /* of a background that is known [1/m^2] */
static const double BIAS_SHARE = 0.1; /* of the newest frame */

/* Variance of a distance at a signal, by the law [m^2]. */
static double law_of(const struct rl_scenery *scenery, double signal)
{
    const struct rl_sensor *sensor = &scenery->samples->sensor;
    const double shot_m = sensor->ranging_shot / fmax(signal, 1e-3);
    return shot_m * shot_m + sensor->ranging_floor_m * sensor->ranging_floor_m;
}

static double to_range(const struct rl_scenery *scenery, int zone, double depth_m)
{
    const struct rl_sensor *sensor = &scenery->samples->sensor;
    return depth_m / sensor->z_per_range[zone] - sensor->range_offset_m;
}

struct rl_zone_sample rl_followed_sample(const struct rl_followed *followed,
                                         const struct rl_scenery *scenery, int zone)
{
    const struct rl_samples *samples = scenery->samples;
    const size_t at = rl_sample(samples, zone, scenery->row);
    const struct rl_zone_light *light = &followed->zone[zone];
    const double signal = (double)samples->signal[at];
    const double noise = rl_noise_variance(samples, zone, signal);
    struct rl_zone_sample sample = {samples->valid[at] != 0, signal - scenery->other[zone],
                                    noise + scenery->other_variance[zone]};
    const double range_m = to_range(scenery, zone, (double)samples->distance[at]);
    if (!sample.valid || !isfinite(range_m)) {
        return sample;
    }
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double beyond_m = range_m - place.range_m;
    const double spread_m =
        5.0 * sqrt(place.variance + followed->noise_scale * law_of(scenery, signal));
    /* A marker that has come nearer is brighter, too. */
    const double nearer = fmax(range_m, RL_NEAREST_M) / fmax(place.range_m, RL_NEAREST_M);
    const double way_m = MAX_CHANGE * (rl_scenery_now(scenery) - followed->ranged_s);
    const double usual = light->level + scenery->other[zone] +
                         followed->light * light->gain * pow(fmin(nearer, 1.0), RL_EXPONENT);
    if (beyond_m < -fmax(NEARER_M, spread_m) &&
        (signal > BRIGHTER * usual + 5.0 * sqrt(noise) || beyond_m < -way_m - 2.0 * NEARER_M)) {
        sample.valid = false;
    }
    return sample;
}

/* Return how far the background is behind the marker, if it is known. Find the probability that it
 * is a background and not the mounting, and the variance over both.
 */
static double behind_of(const struct rl_background *behind, const struct rl_scenery *scenery,
                        double *chance, double *variance)
{
    const double separable_m = scenery->samples->sensor.separable_m;
    const double mounting = RL_MOUNTING_M * RL_MOUNTING_M;
    *chance = 0.0;
    *variance = mounting;
    if (behind->precision < MIN_PRECISION || fabs(behind->offset_m) > separable_m) {
        return 0.0;
    }
    const double noise = 1.0 / behind->precision, spread = noise + mounting;
    const double squared = behind->offset_m * behind->offset_m;
    *chance = rl_chance_apart(squared, spread, separable_m);
    *variance = (1.0 - *chance) * noise * mounting / spread + *chance * noise +
                *chance * (1.0 - *chance) * squared;
    return behind->offset_m;
}

/* Update the background by a dark sample; near a bit's edge the marker has a share in it. */
static void see_behind(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                       double range_m, double signal)
{
    struct rl_background *behind = &followed->behind[zone];
    const struct rl_zone_light *light = &followed->zone[zone];
    const double own = followed->light * fmax(light->gain, 0.0);
    const double share = fmax(light->level, 0.0) / fmax(fmax(light->level, 0.0) + own, 1e-3);
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double noise = followed->noise_scale * law_of(scenery, signal);
    const double precision = share * share / (noise + place.variance);
    const double off_m = range_m - place.range_m - share * behind->offset_m;
    if (share < MIN_BEHIND) {
        return;
    }
    behind->precision += precision;
    behind->offset_m += precision / behind->precision * off_m / share;
}

/* Learn the noise of distances from two successive ones. */
static void learn_noise(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                        double range_m, double variance)
{
    const double now_s = rl_scenery_now(scenery), step_s = now_s - followed->distance_s;
    if (followed->distance_zone == zone && step_s < 1.5 * scenery->samples->period_s) {
        const struct rl_motion place = rl_range_estimate(&followed->range);
        const double off = range_m - followed->distance_m - place.rate * step_s;
        const double expected =
            variance + followed->distance_variance + place.rate_variance * step_s * step_s;
        const double surprise = fmin(off * off / expected, MAX_LESSON);
        followed->noise_scale *= 1.0 + LESSON * (surprise - 1.0);
        followed->noise_scale = fmin(fmax(followed->noise_scale, MIN_SCALE), MAX_SCALE);
    }
    followed->distance_zone = zone;
    followed->distance_m = range_m;
    followed->distance_s = now_s;
    followed->distance_variance = variance;
}

/* Subtract other markers, which merge with this one, from a range and its signal. Find the variance
 * of the range, and the part of it that is by the error of their light, which lasts. False where
 * they do not merge.
 */
static bool subtract_others(const struct rl_scenery *scenery, int zone, double *range_m,
                            double *signal, double *variance, double *lasting)
{
    const double other = scenery->other[zone], whole = *signal;
    *variance = law_of(scenery, whole);
    *lasting = 0.0;
    if (other <= 0.0) {
        return true;
    }
    const double own = fmax(whole - other, 1e-3);
    const double other_m = scenery->other_product[zone] / other;
    const double apart_m = (*range_m - other_m) * whole / own;
    const double error_m = apart_m * sqrt(scenery->other_variance[zone]) / own;
    *lasting = error_m * error_m;
    *variance = whole / own * whole / own * *variance + *lasting;
    *range_m = other_m + apart_m;
    *signal = own;
    return own > MIN_OWN * whole && fabs(apart_m) < scenery->samples->sensor.separable_m;
}

/* The share of the signal that may be the light of an unknown marker. */
static double unknown_share(const struct rl_followed *followed, int zone, double range_m,
                            double signal)
{
    const struct rl_zone_light *light = &followed->zone[zone];
    const double before_m = fmax(rl_range_estimate(&followed->range).range_m, RL_NEAREST_M);
    const double brighter = pow(fmax(range_m, RL_NEAREST_M) / before_m, RL_EXPONENT);
    const double rise = signal - light->level, own = followed->light * light->gain;
    const double off = fmin(fabs(rise - own), fabs(rise - brighter * own)) / fmax(signal, 1e-3);
    return off * sqrt(rl_presence_doubt(&followed->presence));
}

/* Update the range. The background stays where it is, so its offset changes. */
static void correct_range(struct rl_followed *followed, double range_m, double variance,
                          double share, int zones)
{
    const double before_m = rl_range_estimate(&followed->range).range_m;
    rl_range_update(&followed->range, range_m, variance, share);
    const double nearer_m = before_m - rl_range_estimate(&followed->range).range_m;
    for (int zone = 0; zone < zones; zone++) {
        followed->behind[zone].offset_m += nearer_m;
    }
}

static void measure_range(struct rl_followed *followed, const struct rl_scenery *scenery, int zone,
                          double range_m, double signal)
{
    double law, lasting;
    if (!subtract_others(scenery, zone, &range_m, &signal, &law, &lasting)) {
        return;
    }
    const struct rl_zone_light *light = &followed->zone[zone];
    const double share = fmin(fmax(light->level / fmax(signal, 1e-3), 0.0), 1.0 - MIN_OWN);
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const double unknown_m = UNKNOWN_M * unknown_share(followed, zone, range_m, signal);
    const double variance = followed->noise_scale * law + unknown_m * unknown_m;
    double chance, offset_variance;
    const double offset_m =
        behind_of(&followed->behind[zone], scenery, &chance, &offset_variance);
    const double mixed = share * chance;
    const double own_m = (range_m - mixed * (offset_m + place.range_m)) / (1.0 - mixed);
    const double off = own_m - place.range_m;
    /* The marker may have changed its direction while it was dark, if no other light is there. */
    const double way_m = MAX_CHANGE * (rl_scenery_now(scenery) - followed->ranged_s) *
                         (1.0 - rl_presence_doubt(&followed->presence));
    if (off * off > GATE * (place.variance + variance) + way_m * way_m) {
        return;
    }
    followed->ranged_s = rl_scenery_now(scenery);
    learn_noise(followed, scenery, zone, range_m, variance);
    /* Frames count by their precision, which grows with the square of the light. */
    followed->bias_variance +=
        BIAS_SHARE * followed->light * followed->light *
        (share * share * offset_variance + lasting - followed->bias_variance);
    correct_range(followed, own_m, variance, 1.0 - mixed, scenery->samples->zones);
}

void rl_followed_range(struct rl_followed *followed, const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    const int zone = rl_followed_strongest(followed, samples);
    const struct rl_zone_light *light = &followed->zone[zone];
    const struct rl_zone_sample sample = rl_followed_sample(followed, scenery, zone);
    const size_t at = rl_sample(samples, zone, scenery->row);
    const double signal = (double)samples->signal[at];
    const double range_m = to_range(scenery, zone, (double)samples->distance[at]);
    const double own = sample.signal - light->level;
    if (!sample.valid || !isfinite(range_m)) {
        return;
    }
    if (followed->light > RANGED_LIGHT) {
        if (own > MIN_OWN * signal && own > 3.0 * sqrt(sample.variance)) {
            measure_range(followed, scenery, zone, range_m, signal);
        }
    } else if (followed->light < 1.0 - RL_BRIGHT && scenery->other[zone] < MAX_OTHER * signal &&
               own < followed->light * light->gain + 5.0 * sqrt(sample.variance)) {
        see_behind(followed, scenery, zone, range_m, signal);
    }
}
