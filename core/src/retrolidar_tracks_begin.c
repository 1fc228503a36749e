/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Begin a track: fit its own packet together with the light of the markers beside it. */
#include "retrolidar_followed.h"

#include "retrolidar_ranging.h"

#include <math.h>
#include <string.h>

/* Probability that a marker continues after a reading that repeats, and after a lone packet. */
static const double REPEATS = 0.98, ALONE = 0.7;
/* Beyond this range a track has run away. */
static const double FARTHEST_M = 10.0;
/* Relative error of a gain fitted anew, as the marker may have moved during the other's packet. */
static const double REFITTED_GAIN = 0.1;

/* Rows of a reading. */
struct window {
    int first, rows;
};

bool rl_tracks_is_there(const struct rl_followed *followed)
{
    const struct rl_motion place = rl_range_estimate(&followed->range);
    return followed->presence.log_odds > 0.0 && place.range_m > RL_NEAREST_M &&
           place.range_m < FARTHEST_M && place.variance < FARTHEST_M * FARTHEST_M;
}

void rl_tracks_go_to(struct rl_tracks *tracks, int row, double since_s)
{
    struct rl_scenery *scenery = &tracks->scenery;
    scenery->row = row;
    scenery->step_s = fmax(scenery->samples->end_s[row] - since_s, 0.0);
    memset(scenery->other, 0, sizeof scenery->other);
    memset(scenery->other_variance, 0, sizeof scenery->other_variance);
    memset(scenery->other_product, 0, sizeof scenery->other_product);
}

void rl_tracks_add_light(struct rl_scenery *scenery, const struct rl_followed *followed,
                         double light, double sign)
{
    const int strongest = rl_followed_strongest(followed, scenery->samples);
    const double range_m = rl_range_estimate(&followed->range).range_m;
    for (int zone = 0; zone < scenery->samples->zones; zone++) {
        const struct rl_zone_light *one = &followed->zone[zone];
        const double seen = light * fmax(one->gain, 0.0);
        if (rl_zone_sees(followed->zone, scenery->samples, zone, strongest)) {
            scenery->other[zone] += sign * seen;
            scenery->other_product[zone] += sign * seen * range_m;
            scenery->other_variance[zone] += sign * light * light * one->gain_variance;
        }
    }
}

static bool is_beside(const struct rl_tracks *tracks, const struct rl_followed *followed, int zone)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    const int strongest = rl_followed_strongest(followed, samples);
    return rl_zone_beside(zone, strongest, samples->sensor.columns);
}

static double light_of(const struct rl_followed *followed, const struct rl_samples *samples,
                       int row)
{
    double light;
    rl_template(&followed->transmission, &samples->begin_s[row], &samples->end_s[row], 1, &light);
    return light;
}

/* Add the light of all markers beside a zone but one: of tracks, and of that which begins. */
static void add_neighbours(struct rl_tracks *tracks, int zone, const struct rl_followed *own)
{
    struct rl_scenery *scenery = &tracks->scenery;
    for (int i = 0; i <= tracks->count; i++) {
        const struct rl_followed *other = &tracks->track[i];
        if (other != own && is_beside(tracks, other, zone)) {
            rl_tracks_add_light(scenery, other, light_of(other, scenery->samples, scenery->row),
                                1.0);
        }
    }
}

/* Fit levels and gains of all zones to the rows of a reading in a zone. */
static void fit(struct rl_tracks *tracks, const struct rl_followed *followed, int zone,
                const struct window *window, struct rl_zone_light *fitted)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    struct rl_zone_sums sums[RL_MAX_ZONES];
    memset(sums, 0, sizeof sums);
    for (int row = window->first; row < window->first + window->rows; row++) {
        rl_tracks_go_to(tracks, row, INFINITY);
        add_neighbours(tracks, zone, followed);
        const double light = light_of(followed, samples, row);
        for (int i = 0; i < samples->zones; i++) {
            const struct rl_zone_sample sample = rl_followed_sample(followed, &tracks->scenery, i);
            rl_zone_add(&sums[i], &sample, light);
        }
    }
    for (int i = 0; i < samples->zones; i++) {
        fitted[i] = rl_zone_fit(&sums[i]);
    }
}

/* Fit a marker that is followed anew: a part of its level is the light of the one that begins. */
static void refit(struct rl_tracks *tracks, struct rl_followed *old, const struct rl_followed *new,
                  int zone, const struct window *window)
{
    const int zones = tracks->scenery.samples->zones;
    const int strongest = rl_followed_strongest(new, tracks->scenery.samples);
    struct rl_zone_light fitted[RL_MAX_ZONES];
    fit(tracks, old, zone, window, fitted);
    for (int i = 0; i < zones; i++) {
        if (rl_zone_sees(new->zone, tracks->scenery.samples, i, strongest)) {
            const double doubt = REFITTED_GAIN * fitted[i].gain;
            fitted[i].gain_variance += doubt * doubt;
            old->zone[i] = fitted[i];
            old->behind[i] = (struct rl_background){0.0, 0.0};
        }
    }
    rl_presence_start(&old->presence, REPEATS);
}

/* Fit the marker that begins, and then those beside it. */
static void fit_all(struct rl_tracks *tracks, struct rl_followed *followed, int zone,
                    const struct window *window)
{
    struct rl_zone_light fitted[RL_MAX_ZONES];
    fit(tracks, followed, zone, window, fitted);
    memcpy(followed->zone, fitted, (size_t)tracks->scenery.samples->zones * sizeof *fitted);
    for (int i = 0; i < tracks->count; i++) {
        if (is_beside(tracks, &tracks->track[i], zone)) {
            refit(tracks, &tracks->track[i], followed, zone, window);
        }
    }
}

static void see(struct rl_tracks *tracks, const struct rl_followed *followed, int zone, int row)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    rl_tracks_go_to(tracks, row, row > 0 ? samples->end_s[row - 1] : samples->begin_s[row]);
    add_neighbours(tracks, zone, followed);
}

/* Go through the packet, and from there to the newest frame. */
static void replay(struct rl_tracks *tracks, struct rl_followed *followed,
                   const struct rl_reading *reading, const struct window *window)
{
    const double chance = reading->verdict.transmission.repeats ? REPEATS : ALONE;
    rl_presence_start(&followed->presence, chance);
    for (int row = 0; row < window->rows; row++) {
        see(tracks, followed, reading->zone[0], window->first + row);
        rl_followed_replay(followed, &tracks->scenery, tracks->light[row]);
    }
    /* The first choice of its zone is no crossing. */
    const double crossed = followed->crossed;
    rl_followed_bearing(followed, &tracks->scenery);
    followed->crossed = crossed;
    followed->shared_s = rl_scenery_now(&tracks->scenery);
    /* The packet that was read says nothing of what it sends next. */
    rl_presence_start(&followed->presence, chance);
    for (int row = window->first + window->rows; row < tracks->scenery.samples->count; row++) {
        see(tracks, followed, reading->zone[0], row);
        rl_followed_predict(followed, &tracks->scenery);
        rl_followed_update(followed, &tracks->scenery);
    }
}

bool rl_tracks_begin(struct rl_tracks *tracks, const struct rl_reading *reading)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    struct rl_followed *followed = &tracks->track[tracks->count];
    const int zone = reading->zone[0];
    const struct rl_verdict *verdict = &reading->verdict;
    const double packet_s = RL_PACKET_BITS * verdict->transmission.bit_s;
    const double early_s = samples->period_s / 4;
    const double begin_s = fmax(verdict->begin_s, verdict->end_s - packet_s);
    const int first = rl_samples_row(samples, begin_s + early_s);
    const int end_row = rl_samples_row(samples, verdict->end_s + early_s);
    const struct window window = {first,
                                  (end_row < samples->count ? end_row : samples->count) - first};
    if (window.rows < 2 || !reading->is_placed) {
        return false;
    }
    rl_followed_start(followed, reading);
    rl_template(&followed->transmission, samples->begin_s + first, samples->end_s + first,
                window.rows, tracks->light);
    for (int i = 0; i < samples->zones; i++) {
        followed->zone[i].level = INFINITY; /* before it is known, nothing is too bright */
    }
    fit_all(tracks, followed, zone, &window);
    rl_zone_doubt(followed->zone, samples->zones, reading);
    replay(tracks, followed, reading, &window);
    return rl_tracks_is_there(followed);
}
