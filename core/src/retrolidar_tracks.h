/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Markers that are followed once they are read: a place with every frame.
 *
 * Then every bit to come is known. So each frame in which the marker is bright measures its range
 * and its share in each zone again, and bits that do not come as predicted count against it.
 */
#ifndef RETROLIDAR_TRACKS_H
#define RETROLIDAR_TRACKS_H

#include "retrolidar_detector.h"

/* binding */
enum { RL_MAX_TRACKS = 64 };

/* A marker at the newest frame, in the optical frame: x right, y down, z forward. */
struct rl_marker_track {
    uint16_t id;
    double tangent[2], tangent_variance[2]; /* x/z and y/z */
    double range_m, range_variance;
    double range_rate, range_rate_variance; /* [m/s] */
    double log_odds;                        /* that it is there, and the same [nats] */
    double first_s;                         /* when its first packet began */
    int64_t last_ns;                        /* the newest frame with its light */
};

struct rl_track_counts {
    uint64_t started, ended, dropped; /* dropped: as there were more than are followed */
};

struct rl_tracks;

/* Memory is taken here and never after; NULL if there is none. The detector is to be kept. */
struct rl_tracks *rl_tracks_create(struct rl_detector *detector);
void rl_tracks_destroy(struct rl_tracks *tracks);

/* Follow all markers to the frame that the detector has taken last, and begin with those that it
 * has read with it; return how many are followed. Call it after every frame.
 */
int32_t rl_tracks_follow(struct rl_tracks *tracks);

struct rl_marker_track rl_tracks_track(const struct rl_tracks *tracks, int32_t index);
struct rl_track_counts rl_tracks_counts(const struct rl_tracks *tracks);
/* end of binding */

#endif
