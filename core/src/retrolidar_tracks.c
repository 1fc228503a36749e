/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_tracks.h"

#include "retrolidar_detector_state.h"
#include "retrolidar_followed.h"
#include "retrolidar_math.h"
#include "retrolidar_ranging.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* That a marker goes on after a reading: one that repeats, and one that sent a packet alone. */
static const double REPEATS = 0.98, ALONE = 0.7;
/* A reading is of another transmission if it is off by so many bits. */
static const double MOST_OFF_BITS = 0.5;
/* Of a marker that crosses the view [m/s]. */
static const double ACROSS_M_S = 0.5;
/* Gains are of the frames before. */
static const double LAG_S = 0.03;
/* What the sensor does not reach. */
static const double FARTHEST_M = 10.0;
/* By how much the light of another marker is wrong, as a share of it. */
static const double OTHER_ERROR = 0.1;

enum { MOST_ROWS = 64 }; /* from one call to the next */

struct rl_tracks {
    struct rl_detector *detector;
    struct rl_track_counts counts;
    int count;
    struct rl_followed track[RL_MAX_TRACKS];
    int64_t origin_ns, last_ns; /* of the samples, and of the newest frame */
    struct rl_scenery scenery;
    double *light; /* room for a window, as has the next */
    float *distance;
};

struct rl_tracks *rl_tracks_create(struct rl_detector *detector, const float *size_m)
{
    const size_t rows = (size_t)detector->samples.capacity;
    const size_t a_row = sizeof(double) + sizeof(float);
    struct rl_tracks *tracks = calloc(1, sizeof *tracks + rows * a_row);
    if (tracks == NULL) {
        return NULL;
    }
    tracks->detector = detector;
    tracks->light = (double *)(tracks + 1);
    tracks->distance = (float *)(tracks->light + rows);
    tracks->scenery = (struct rl_scenery){
        .samples = &detector->samples,
        .sensor = &detector->samples.sensor,
        .size_m = size_m,
        .table = &detector->bearing,
    };
    tracks->origin_ns = RL_NO_FRAME;
    return tracks;
}

void rl_tracks_destroy(struct rl_tracks *tracks)
{
    free(tracks);
}

static void end(struct rl_tracks *tracks, int index)
{
    tracks->track[index] = tracks->track[--tracks->count];
    tracks->counts.ended++;
}

/* Whether a marker is likely to be there still, and where the sensor sees. */
static bool is_there(const struct rl_followed *followed)
{
    const struct rl_motion place = rl_range_estimate(&followed->range);
    return followed->presence.log_odds > 0.0 && place.range_m > RL_NEAREST_M &&
           place.range_m < FARTHEST_M && place.variance < FARTHEST_M * FARTHEST_M;
}

/* Look at a row, in which there is no light of other markers yet. */
static void go_to(struct rl_tracks *tracks, int row, double since_s)
{
    struct rl_scenery *scenery = &tracks->scenery;
    scenery->row = row;
    scenery->step_s = fmax(scenery->samples->end_s[row] - since_s, 0.0);
    memset(scenery->other, 0, sizeof scenery->other);
    memset(scenery->other_variance, 0, sizeof scenery->other_variance);
}

/* Add the light of a marker in the row, or take it off. */
static void add_light(struct rl_scenery *scenery, const struct rl_followed *followed, double light,
                      double sign)
{
    const int strongest = rl_zone_strongest(followed->zone, scenery->samples->zones);
    for (int zone = 0; zone < scenery->samples->zones; zone++) {
        const struct rl_zone_light *one = &followed->zone[zone];
        const double seen = light * fmax(one->gain, 0.0);
        if (rl_zone_sees(followed->zone, zone, strongest)) {
            scenery->other[zone] += sign * seen;
            const double error = OTHER_ERROR * seen;
            scenery->other_variance[zone] +=
                sign * (light * light * one->gain_variance + error * error);
        }
    }
}

static void add_neighbours(struct rl_tracks *tracks, int zone)
{
    struct rl_scenery *scenery = &tracks->scenery;
    const struct rl_samples *samples = scenery->samples;
    for (int i = 0; i < tracks->count; i++) {
        const struct rl_followed *other = &tracks->track[i];
        const int strongest = rl_zone_strongest(other->zone, samples->zones);
        if (rl_zone_beside(zone, strongest, samples->columns_of_zones)) {
            double light;
            rl_template(&other->sending, &samples->begin_s[scenery->row],
                        &samples->end_s[scenery->row], 1, &light);
            add_light(scenery, other, light, 1.0);
        }
    }
}

/* The distance of a marker, the middle one of those while it was bright; NaN without any. */
static double depth_of(struct rl_tracks *tracks, int zone, int first, int rows)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    const size_t at = rl_sample(samples, zone, first);
    int count = 0;
    for (int row = 0; row < rows; row++) {
        const float distance = samples->distance[at + (size_t)row];
        if (tracks->light[row] > RL_BRIGHT && !isnan(distance)) {
            tracks->distance[count++] = distance;
        }
    }
    return count > 0 ? (double)rl_select(tracks->distance, count, count / 2) : NAN;
}

/* Begin with a reading, from its own samples on. */
static bool begin(struct rl_tracks *tracks, struct rl_followed *followed,
                  const struct rl_reading *reading)
{
    const struct rl_samples *samples = tracks->scenery.samples;
    const double packet_s = RL_PACKET_BITS * reading->bit_s;
    const int first =
        rl_samples_row(samples, fmax(reading->begin_s, reading->end_s - packet_s) +
                                    samples->period_s / 4);
    const int end_row = rl_samples_row(samples, reading->end_s + samples->period_s / 4);
    const int rows = (end_row < samples->count ? end_row : samples->count) - first;
    if (rows < 2) {
        return false;
    }
    rl_followed_start(followed, reading);
    rl_template(&followed->sending, samples->begin_s + first, samples->end_s + first, rows,
                tracks->light);
    const double depth_m = depth_of(tracks, reading->zone[0], first, rows);
    if (isnan(depth_m)) {
        return false;
    }
    go_to(tracks, first, samples->begin_s[first]);
    rl_followed_place(followed, &tracks->scenery, reading->zone[0], depth_m);
    struct rl_zone_sums sums[RL_MOST_ZONES];
    memset(sums, 0, sizeof sums);
    for (int zone = 0; zone < samples->zones; zone++) {
        followed->zone[zone].level = INFINITY; /* before it is known, nothing is too bright */
    }
    for (int row = 0; row < rows; row++) {
        go_to(tracks, first + row, INFINITY);
        add_neighbours(tracks, reading->zone[0]);
        for (int zone = 0; zone < samples->zones; zone++) {
            const struct rl_zone_sample sample =
                rl_followed_sample(followed, &tracks->scenery, zone);
            rl_zone_add(&sums[zone], &sample, tracks->light[row]);
        }
    }
    for (int zone = 0; zone < samples->zones; zone++) {
        followed->zone[zone] = rl_zone_fit(&sums[zone]);
    }
    rl_zone_doubt(followed->zone, samples->zones, reading);
    const double chance = reading->repeats ? REPEATS : ALONE;
    rl_presence_start(&followed->presence, chance);
    for (int row = first; row < first + rows; row++) {
        go_to(tracks, row, samples->begin_s[row]);
        add_neighbours(tracks, reading->zone[0]);
        rl_followed_replay(followed, &tracks->scenery, tracks->light[row - first]);
    }
    rl_followed_bearing(followed, &tracks->scenery);
    /* That its packet came says nothing of what it sends next. */
    const double unseen_s = followed->presence.unseen_s;
    rl_presence_start(&followed->presence, chance);
    followed->presence.unseen_s = unseen_s;
    followed->first_s = reading->start_s;
    for (int row = first + rows; row < samples->count; row++) {
        go_to(tracks, row, samples->begin_s[row]);
        add_neighbours(tracks, reading->zone[0]);
        rl_followed_predict(followed, &tracks->scenery);
        rl_followed_update(followed, &tracks->scenery);
    }
    return is_there(followed);
}

/* Whether a reading is of the transmission that is followed. */
static bool goes_on(const struct rl_followed *followed, const struct rl_reading *reading)
{
    const double packet_s = RL_PACKET_BITS * reading->bit_s;
    const double cycles = (reading->start_s - followed->sending.start_s) / packet_s;
    return fabs(cycles - floor(cycles + 0.5)) * RL_PACKET_BITS < MOST_OFF_BITS;
}

static int weakest(const struct rl_tracks *tracks)
{
    int least = 0;
    for (int i = 1; i < tracks->count; i++) {
        const double odds = tracks->track[i].presence.log_odds;
        least = odds < tracks->track[least].presence.log_odds ? i : least;
    }
    return least;
}

static void take(struct rl_tracks *tracks, const struct rl_reading *reading)
{
    for (int i = 0; i < tracks->count; i++) {
        if (tracks->track[i].id == reading->id) {
            if (goes_on(&tracks->track[i], reading)) {
                return;
            }
            end(tracks, i--);
        }
    }
    if (tracks->count == RL_MAX_TRACKS) {
        end(tracks, weakest(tracks));
        tracks->counts.ended--;
        tracks->counts.dropped++;
    }
    if (begin(tracks, &tracks->track[tracks->count], reading)) {
        tracks->counts.started++;
        tracks->count++;
    }
}

static void follow(struct rl_tracks *tracks, int row)
{
    struct rl_scenery *scenery = &tracks->scenery;
    const double before_s = row > 0 ? scenery->samples->end_s[row - 1] : -INFINITY;
    go_to(tracks, row, before_s);
    for (int i = 0; i < tracks->count; i++) {
        rl_followed_predict(&tracks->track[i], scenery);
        add_light(scenery, &tracks->track[i], tracks->track[i].light, 1.0);
    }
    for (int i = 0; i < tracks->count; i++) {
        const struct rl_scenery all = *scenery;
        add_light(scenery, &tracks->track[i], tracks->track[i].light, -1.0);
        rl_followed_update(&tracks->track[i], scenery);
        *scenery = all;
    }
    for (int i = tracks->count - 1; i >= 0; i--) {
        if (!is_there(&tracks->track[i])) {
            end(tracks, i);
        }
    }
}

int32_t rl_tracks_follow(struct rl_tracks *tracks)
{
    const struct rl_detector *detector = tracks->detector;
    const struct rl_samples *samples = &detector->samples;
    const int64_t newest_ns = detector->last_ns;
    if (samples->origin_ns != tracks->origin_ns || samples->count == 0) {
        tracks->counts.ended += (uint64_t)tracks->count;
        tracks->count = 0;
        tracks->origin_ns = samples->origin_ns;
        tracks->last_ns = RL_NO_FRAME;
    }
    if (newest_ns == tracks->last_ns || samples->count == 0) {
        return tracks->count;
    }
    int row = samples->count - 1;
    while (row > 0 && (samples->stamp_ns[row - 1] == RL_NO_FRAME ||
                       samples->stamp_ns[row - 1] > tracks->last_ns)) {
        row--; /* frames that were lost are erasures */
    }
    if (samples->count - row > MOST_ROWS) { /* nobody has asked for long */
        tracks->counts.ended += (uint64_t)tracks->count;
        tracks->count = 0;
    }
    for (; row < samples->count && tracks->count > 0; row++) {
        follow(tracks, row);
    }
    tracks->last_ns = newest_ns;
    for (int i = 0; i < detector->readings; i++) {
        take(tracks, &detector->reading[i]);
    }
    return tracks->count;
}

struct rl_marker_track rl_tracks_track(const struct rl_tracks *tracks, int32_t index)
{
    const struct rl_followed *followed = &tracks->track[index];
    const struct rl_motion place = rl_range_estimate(&followed->range);
    const int columns = tracks->scenery.samples->columns_of_zones;
    const int rows = tracks->scenery.samples->rows_of_zones;
    const double pitch = tracks->scenery.sensor->zone_pitch;
    const double middle[2] = {followed->strongest % columns - (columns - 1) / 2.0,
                              followed->strongest / columns - (rows - 1) / 2.0};
    struct rl_marker_track track = {
        .id = followed->id,
        .range_m = place.range_m,
        .range_variance = place.variance + followed->bias_variance,
        .range_rate = place.rate,
        .range_rate_variance = place.rate_variance,
        .log_odds = followed->presence.log_odds,
        .first_s = followed->first_s,
        .last_ns = followed->last_ns,
    };
    const double dark_s = tracks->scenery.samples->end_s[tracks->scenery.row] - followed->shared_s;
    const double moved = followed->crossed * ACROSS_M_S * (dark_s + LAG_S) / place.range_m;
    for (int axis = 0; axis < 2; axis++) {
        track.tangent[axis] = pitch * (middle[axis] + followed->bearing.mean[axis]);
        track.tangent_variance[axis] =
            pitch * pitch * followed->bearing.variance[axis] + moved * moved;
    }
    return track;
}

struct rl_track_counts rl_tracks_counts(const struct rl_tracks *tracks)
{
    return tracks->counts;
}
