/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The packets that have been read lately, in the whole view: who else may be in the samples. */
#ifndef RETROLIDAR_POOL_H
#define RETROLIDAR_POOL_H

#include "retrolidar_samples.h"
#include "retrolidar_window.h"

enum { RL_POOL = 64 };

struct rl_active_track {
    uint16_t id;
    struct rl_packet_train train;
    int zone;             /* that saw it best */
    uint64_t zones, near; /* bit masks: those that saw it, and all of them and around them */
};

struct rl_pool {
    int count;
    struct rl_active_track track[RL_POOL];
};

/* Add a packet, or several that repeat; one that goes on from an active track becomes part of it.
 */
const struct rl_active_track *rl_pool_add(struct rl_pool *pool, const struct rl_samples *samples,
                                          uint16_t id, const struct rl_packet_train *train,
                                          const int32_t *zones, int count);

/* The next active track whose following packet has ended within (from_s, to_s] if it goes on; NULL
 * if there is none from the index on, which it moves.
 */
const struct rl_active_track *rl_pool_due(const struct rl_pool *pool, int *index, double from_s,
                                          double to_s);

/* Whether packets of an ID are held that overlap with a time. */
bool rl_pool_knows(const struct rl_pool *pool, uint16_t id, double begin_s, double end_s,
                   double overlap_s);

/* Whether packets of an ID follow, by the same clock, others that are held. */
bool rl_pool_is_followed(const struct rl_pool *pool, uint16_t id,
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

#endif
