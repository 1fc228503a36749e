/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a detector holds, for the files that it is made of. */
#ifndef RETROLIDAR_DETECTOR_STATE_H
#define RETROLIDAR_DETECTOR_STATE_H

#include "retrolidar_detector.h"
#include "retrolidar_ranging.h"
#include "retrolidar_search.h"

enum {
    RL_POOL = 64,      /* markers that are remembered */
    RL_READINGS = 32,  /* that one frame may bring */
    RL_DECISIONS = 12, /* candidates that are judged with one frame, at the most */
    RL_MAX_PENDING = 5 * RL_MAX_CHANNELS + 15 * RL_MAX_ZONES, /* all of a frame */
    /* That a search for one packet may look back. */
    RL_SEARCH_BITS = 2 * RL_PACKET_BITS + RL_LOOK_BITS,
};
/* A channel that varies by less than so many times its noise holds no packet by itself. */
static const double RL_ACTIVE = 1.5;

/* A marker of which packets were read lately. */
struct rl_active_track {
    uint16_t id;
    struct rl_packet_train train;
    double word;          /* statistic of the last packet that was read */
    int zone;             /* that saw it best */
    uint64_t zones, near; /* bit masks: those that saw it, and all of them and around them */
};

struct rl_pool {
    int count;
    struct rl_active_track track[RL_POOL];
};

/* Room to subtract packets from samples, and to put these back. */
struct rl_residual {
    struct rl_samples *samples;
    struct rl_room room;
    double *light[2], *part; /* of a marker that has ended, and that goes on */
    float *saved; /* signals of each channel before */
    int first;    /* row from which they were saved */
};

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
    double max_llr_deficit; /* nats by which other sequences than hits may be better */
    double consumed_until_s[RL_MAX_CHANNELS]; /* end of what was read last in each */
    uint64_t read_anew; /* zones that saw what was read since the last search of the residual, and
                         * those around them */
    double active_s[RL_MAX_ZONES]; /* since when each varies by more than noise; infinite if not */
    int readings, decisions_left;
    struct rl_reading reading[RL_READINGS];
    int candidates;
    struct rl_verdict candidate[2 * RL_DECISIONS];
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

/* Place the marker of a reading of the newest frame; false where no distance was measured. Every
 * zone that has read it gives its range, and all zones around the strongest its bearing.
 */
bool rl_place(struct rl_detector *detector, const struct rl_reading *reading,
              struct rl_placement *placement);

/* Whether packets of an ID are held that overlap with a time. */
bool rl_pool_knows(const struct rl_pool *pool, uint16_t id, double begin_s, double end_s,
                   double overlap_s);

/* The packets of an ID that a train follows by the same clock; NULL if none are held. */
const struct rl_active_track *rl_pool_followed(const struct rl_pool *pool, uint16_t id,
                                               const struct rl_packet_train *train);

/* Find what may be in some zones from one time to another besides an ID: what was read in them
 * first, then what was read beside them. Those whose last packet ended before `since_s` are over.
 */
void rl_pool_interference(const struct rl_pool *pool, uint64_t zones, double since_s, double to_s,
                          uint16_t except, struct rl_interference *interference);

/* Zones that saw what was read until a time or later, and those around them. */
uint64_t rl_pool_zones(const struct rl_pool *pool, double since_s);

/* The zones of a channel as a bit mask. */
uint64_t rl_channel_zones(const struct rl_samples *samples, int channel);

void rl_residual_start(struct rl_residual *residual, struct rl_samples *samples,
                       struct rl_memory *memory);

/* Subtract transmissions from the samples of a zone since a time. Return how the rest varies over
 * the newest rows, a packet's length of them, in the variance of noise.
 */
double rl_residual_subtract(struct rl_residual *residual, int zone,
                            const struct rl_interference *interference, double from_s);

/* Subtract what another zone sees, as far as that explains the zone. Return the same. */
double rl_residual_cancel(struct rl_residual *residual, int zone, int reference, double from_s);

/* The same of a sum of zones, once transmissions are subtracted from its zones. */
double rl_residual_sum(struct rl_residual *residual, int channel);

/* Put the samples of a channel back. */
void rl_residual_restore(struct rl_residual *residual, int channel);

#endif
