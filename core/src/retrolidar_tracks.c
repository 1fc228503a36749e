/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_detector_state.h"
#include "retrolidar_followed.h"

#include <math.h>
#include <stdlib.h>

/* Speed of a marker that crosses the view [m/s]. */
static const double ACROSS_M_S = 0.5;
/* Gains lag by this time. */
static const double LAG_S = 0.03;

enum { MAX_ROWS = 64 }; /* from one call to the next */

struct rl_tracks *rl_tracks_create(struct rl_detector *detector)
{
    const size_t rows = (size_t)detector->samples.capacity;
    struct rl_tracks *tracks = calloc(1, sizeof *tracks + rows * sizeof(double));
    if (tracks == NULL) {
        return NULL;
    }
    tracks->detector = detector;
    tracks->light = (double *)(tracks + 1);
    tracks->scenery = (struct rl_scenery){
        .samples = &detector->samples,
        .table = &detector->bearing,
    };
    tracks->origin_ns = RL_NO_FRAME;
    return tracks;
}

void rl_tracks_destroy(struct rl_tracks *tracks)
{
    free(tracks);
}

static void remove_track(struct rl_tracks *tracks, int index)
{
    tracks->track[index] = tracks->track[--tracks->count];
}

static void end(struct rl_tracks *tracks, int index)
{
    remove_track(tracks, index);
    tracks->counts.ended++;
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

/* Begin with a reading; or anew, if its marker is followed but lost. */
static void take(struct rl_tracks *tracks, const struct rl_reading *reading)
{
    double first_s = INFINITY;
    for (int i = 0; i < tracks->count; i++) {
        const struct rl_followed *before = &tracks->track[i];
        if (before->id == reading->verdict.id) {
            if (rl_followed_lost(before) < 1.0) {
                return;
            }
            first_s = before->first_s;
            remove_track(tracks, i);
            break;
        }
    }
    const bool was_followed = first_s < INFINITY;
    if (!rl_tracks_begin(tracks, reading)) {
        tracks->counts.ended += was_followed;
        return;
    }
    struct rl_followed *begun = &tracks->track[tracks->count];
    begun->first_s = fmin(begun->first_s, first_s);
    tracks->counts.started += !was_followed;
    if (++tracks->count > RL_MAX_TRACKS) {
        remove_track(tracks, weakest(tracks));
        tracks->counts.dropped++;
    }
}

static void follow(struct rl_tracks *tracks, int row)
{
    struct rl_scenery *scenery = &tracks->scenery;
    const double before_s = row > 0 ? scenery->samples->end_s[row - 1] : -INFINITY;
    rl_tracks_go_to(tracks, row, before_s);
    for (int i = 0; i < tracks->count; i++) {
        rl_followed_predict(&tracks->track[i], scenery);
        rl_tracks_add_light(scenery, &tracks->track[i], tracks->track[i].light, 1.0);
    }
    for (int i = 0; i < tracks->count; i++) {
        const struct rl_scenery all = *scenery;
        rl_tracks_add_light(scenery, &tracks->track[i], tracks->track[i].light, -1.0);
        rl_followed_update(&tracks->track[i], scenery);
        *scenery = all;
    }
    for (int i = tracks->count - 1; i >= 0; i--) {
        if (!rl_tracks_is_there(&tracks->track[i])) {
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
    if (samples->count - row > MAX_ROWS) { /* nobody has asked for long */
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
    const int columns = tracks->scenery.samples->sensor.columns;
    const int rows = tracks->scenery.samples->sensor.rows;
    const double pitch = tracks->scenery.samples->sensor.zone_pitch;
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
    /* A marker that is lost may have moved, too. */
    const double moves = fmax(followed->crossed, rl_followed_lost(followed));
    const double moved = moves * ACROSS_M_S * (dark_s + LAG_S) / place.range_m;
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
