/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What is kept of all tracks, and how one begins. */
#ifndef RETROLIDAR_TRACKS_STATE_H
#define RETROLIDAR_TRACKS_STATE_H

#include "retrolidar_detector_state.h"
#include "retrolidar_followed.h"

struct rl_tracks {
    struct rl_detector *detector;
    struct rl_track_counts counts;
    int count;
    struct rl_followed track[RL_MAX_TRACKS + 1]; /* and one that begins */
    int64_t origin_ns, last_ns; /* of the samples, and of the newest frame */
    struct rl_scenery scenery;
    double *light; /* room for a window, as has the next */
    float *distance;
};

/* Look at a row, in which there is no light of other markers yet. */
void rl_tracks_go_to(struct rl_tracks *tracks, int row, double since_s);

/* Add the light of a marker in the row, or take it off. */
void rl_tracks_add_light(struct rl_scenery *scenery, const struct rl_followed *followed,
                         double light, double sign);

/* Whether a marker is likely to be there still, and where the sensor sees. */
bool rl_tracks_is_there(const struct rl_followed *followed);

/* Begin with a reading, in the place behind the last track; return whether it is one. */
bool rl_tracks_begin(struct rl_tracks *tracks, const struct rl_reading *reading);

#endif
