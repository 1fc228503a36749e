/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a detector holds, for the files that it is made of. */
#ifndef RETROLIDAR_DETECTOR_STATE_H
#define RETROLIDAR_DETECTOR_STATE_H

#include "retrolidar_bearing.h"
#include "retrolidar_constants.h"
#include "retrolidar_detector.h"
#include "retrolidar_pool.h"
#include "retrolidar_ranging.h"
#include "retrolidar_residual.h"
#include "retrolidar_search.h"

enum {
    RL_READINGS = 32,  /* that one frame may bring */
    RL_DECISIONS = 12, /* candidates that are judged with one frame, at the most */
    RL_MAX_PENDING = 5 * RL_MAX_CHANNELS + 15 * RL_MAX_ZONES, /* all of a frame */
    /* That a search for one packet may look back. */
    RL_SEARCH_BITS = 2 * RL_PACKET_BITS + RL_LOOK_BITS,
};
/* A channel that varies by less than so many times its noise holds no packet by itself. */
static const double RL_ACTIVE = 1.5;

/* What a search has found in a channel, not judged yet. */
struct rl_pending {
    int channel, packets;
    double since_s; /* earlier samples are left out */
    struct rl_hits hits;
};

struct rl_detector {
    struct rl_settings settings;
    struct rl_samples samples;
    struct rl_search search;
    struct rl_window window;
    struct rl_residual residual;
    struct rl_pool pool;
    struct rl_bearing_table bearing;
    float *values; /* room for placing, of a row each ... */
    uint8_t *role;
    double *other; /* ... and of RL_MAX_OTHERS rows */
    char *memory;  /* of all arrays */
    struct rl_counts counts;
    int64_t last_ns;
    double looked_s;
    double
        max_llr_deficit; /* nats by which other sequences than the hits of a search may be better */
    double consumed_until_s[RL_MAX_CHANNELS]; /* end of what was read last in each */
    uint64_t read_anew; /* zones that saw what was read since the last search of the residual, and
                         * those around them */
    double active_s[RL_MAX_ZONES]; /* since when each varies by more than noise; infinite if not */
    int readings, decisions_left;
    struct rl_reading reading[RL_READINGS];
    int candidates;
    struct rl_candidate candidate[2 * RL_DECISIONS];
    struct rl_hits hits[RL_MAX_CHANNELS], behind;
    struct rl_pending pending[RL_MAX_PENDING];
    int pendings;
};

/* Search the newest samples, and judge what is found, the most promising first. */
void rl_process_frame(struct rl_detector *detector);

/* Judge the best hit of a channel, and what it may hide. */
void rl_judge(struct rl_detector *detector, const struct rl_pending *pending, double to_s);

/* Note a packet that is read. The window's interference is the verdict's. */
void rl_add_reading(struct rl_detector *detector, const struct rl_verdict *verdict);

/* Place the marker of a reading of the frame that was taken last; false where no distance was
 * measured. Every zone that has read it gives its range, and all zones around the strongest its
 * bearing.
 */
bool rl_place(struct rl_detector *detector, const struct rl_reading *reading,
              struct rl_placement *placement);

#endif
