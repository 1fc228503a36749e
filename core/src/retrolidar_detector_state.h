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
    RL_POOL = 64,      /* active tracks that are held */
    RL_READINGS = 32,  /* per frame, at most */
    RL_DECISIONS = 12, /* candidates that are judged per frame, at most */
    RL_MAX_PENDING = 4 * RL_MAX_CHANNELS + 5 * RL_MAX_ZONES, /* all of a frame */
    /* A search for one packet reads so many of the newest bits. */
    RL_SEARCH_BITS = 2 * RL_PACKET_BITS + RL_LOOK_BITS,
};
/* A channel whose variance is less than so many times its noise's holds no packet by itself. */
static const double RL_ACTIVE = 1.5;

/* A marker of which packets were read lately. */
struct rl_active_track {
    uint16_t id;
    struct rl_packet_train train;
    double word;          /* statistic of the last packet that was read */
    int zone;             /* the strongest one */
    uint64_t zones, near; /* bit masks: zones that saw it, and these with those beside them */
};

struct rl_pool {
    int count;
    struct rl_active_track track[RL_POOL];
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
    struct rl_window window, other_zone[RL_SUMMED - 1];
    struct rl_pool pool;
    struct rl_bearing_table bearing;
    float *saved;  /* signals of each channel, before packets were subtracted ... */
    int saved_row; /* ... from this row on */
    float *values; /* room for placing, of a row each ... */
    uint8_t *role;
    double *other; /* ... and of RL_MAX_OTHERS rows */
    char *memory;  /* of all arrays */
    struct rl_counts counts;
    int64_t last_ns;
    double newest_s; /* end of the newest frame that is searched */
    /* Nats that a hit must have, and by which any bits may be better than a hit. */
    double min_nats, max_llr_deficit;
    double read_until_s[RL_MAX_CHANNELS]; /* end of the last packet read in each */
    uint64_t read_anew; /* zones, and those beside them, that saw packets read since the last search
                         * of the residual ... */
    double read_from_s; /* ... and when the first of these began */
    double active_s[RL_MAX_ZONES]; /* since when each varies more than noise; INFINITY if not */
    int readings, decisions_left;
    struct rl_reading reading[RL_READINGS];
    int candidates;
    struct rl_verdict candidate[2 * RL_DECISIONS]; /* that were judged; two of each pair */
    struct rl_hits hits[RL_MAX_CHANNELS];
    struct rl_pending pending[RL_MAX_PENDING];
    int pendings;
};

/* Search the newest samples, and judge what is found, the most promising first. */
void rl_process_frame(struct rl_detector *detector);

/* Judge the best hit of a channel, and what it may hide. */
void rl_judge(struct rl_detector *detector, const struct rl_pending *pending);

/* Judge packets of any ID that are expected where another one of a marker ends or begins. */
void rl_judge_expected(struct rl_detector *detector, double from_s);

/* By how much two new packets in a zone are likelier than any others of the same sum, if they begin
 * together [nats]; 0 if their last bits may be still to come.
 */
double rl_pair_margin(struct rl_detector *detector, const struct rl_verdict *one,
                      const struct rl_verdict *other);

/* The same of a packet and any known marker that begins its packets together with it. */
double rl_pair_margin_beside_known(struct rl_detector *detector, const struct rl_verdict *verdict);

/* Note a packet that is read. The window's interference is the verdict's. */
void rl_add_reading(struct rl_detector *detector, const struct rl_verdict *verdict);

/* Find the range and the bearing of a reading; false if no distance was measured. The range is from
 * all zones that saw the packet, the bearing from the strongest zone and those beside it.
 */
bool rl_place(struct rl_detector *detector, const struct rl_reading *reading,
              struct rl_placement *placement);

/* Insert a zone into a list of RL_MAX_READ at the most, the strongest first. */
void rl_add_zone(int32_t *zones, int32_t *count, int zone, const double *strength);

/* The packets of a verdict as a train. */
struct rl_packet_train rl_train_of(const struct rl_verdict *verdict);

/* Whether packets of an ID were read that overlap with a time by more than a few bits. */
bool rl_is_known(const struct rl_detector *detector, uint16_t id, double begin_s, double end_s);

/* The packets of an ID that a train follows by the same clock; NULL if none are held. */
const struct rl_active_track *rl_pool_followed(const struct rl_pool *pool, uint16_t id,
                                               const struct rl_packet_train *train);

/* Whether a packet of any ID was read in some zones when one would begin. */
bool rl_pool_has(const struct rl_pool *pool, uint64_t zones, const struct rl_packet_train *packet);

/* Whether a packet begins where one lone one that some zones saw ends, or ends where one begins. */
bool rl_pool_expects(const struct rl_pool *pool, uint64_t zones,
                     const struct rl_packet_train *packet);

/* List the trains of IDs other than two that some zones may see: first those read in these zones,
 * then those read beside them. Trains that ended before `since_s` are left out.
 */
void rl_pool_interference(const struct rl_pool *pool, uint64_t zones, double since_s, uint16_t id,
                          uint16_t other_id, struct rl_interference *interference);

/* Add a packet to the interference, in place of the last one if that is full. */
void rl_interference_add(struct rl_interference *interference, const struct rl_verdict *verdict);

/* Zones that saw a train which ended after a time, and the zones beside them. */
uint64_t rl_pool_zones(const struct rl_pool *pool, double since_s);

/* Subtract packets that were read from a zone's samples since `from_s`, as far as they are seen
 * there. Return the variance of the rest over the newest packet's length, over that of the noise.
 *
 * since_s: packets that ended earlier are not subtracted
 * beside: another packet that is subtracted, in place of all of its ID, if not NULL
 */
double rl_residual_subtract(struct rl_detector *detector, int zone, double since_s, double from_s,
                            const struct rl_verdict *beside);

/* Sum the zones of a channel anew, after transmissions were subtracted. Return the same. */
double rl_residual_sum(struct rl_detector *detector, int channel);

/* Put the samples of a channel back. */
void rl_residual_restore(struct rl_detector *detector, int channel);

#endif
