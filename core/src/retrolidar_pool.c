/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_pool.h"

#include "retrolidar_constants.h"

#include <math.h>

/* A packet goes on from one before it if it keeps its time, and no more packets were missed. */
static const double MAX_MISSED = 2.0;

uint64_t rl_channel_zones(const struct rl_samples *samples, int channel)
{
    uint64_t zones = 0;
    for (int i = 0; i < samples->channel[channel].zones; i++) {
        zones |= (uint64_t)1 << samples->channel[channel].zone[i];
    }
    return zones;
}

static uint64_t around(const struct rl_samples *samples, int zone)
{
    uint64_t zones = 0;
    for (int other = 0; other < samples->zones; other++) {
        const bool is_beside = rl_zone_beside(zone, other, samples->columns_of_zones);
        zones |= (uint64_t)is_beside << other;
    }
    return zones;
}

/* A slot for another track: an empty one, or else that of the track that ended first. */
static struct rl_active_track *free_slot(struct rl_pool *pool)
{
    if (pool->count < RL_POOL) {
        return &pool->track[pool->count++];
    }
    struct rl_active_track *first = pool->track;
    for (int i = 1; i < pool->count; i++) {
        first = pool->track[i].train.end_s < first->train.end_s ? &pool->track[i] : first;
    }
    return first;
}

/* Whether a transmission goes on from another one. */
static bool continues(const struct rl_packet_train *before, const struct rl_packet_train *now)
{
    const double packet_s = RL_PACKET_BITS * now->transmission.bit_s;
    return now->begin_s - before->end_s < MAX_MISSED * packet_s && rl_keeps_time(before, now);
}

const struct rl_active_track *rl_pool_add(struct rl_pool *pool, const struct rl_samples *samples,
                                          uint16_t id, const struct rl_packet_train *train,
                                          const int32_t *zones, int count)
{
    struct rl_active_track *track = NULL;
    struct rl_packet_train whole = *train;
    for (int i = 0; i < pool->count; i++) {
        struct rl_active_track *before = &pool->track[i];
        if (before->id == id && continues(&before->train, train)) {
            track = before;
            whole.begin_s = fmin(track->train.begin_s, whole.begin_s);
            whole.end_s = fmax(track->train.end_s, whole.end_s);
            whole.transmission.repeats = true;
        }
    }
    if (track == NULL) {
        track = free_slot(pool);
    }
    *track = (struct rl_active_track){.id = id, .train = whole, .zone = zones[0]};
    for (int i = 0; i < count; i++) {
        track->zones |= (uint64_t)1 << zones[i];
        track->near |= around(samples, zones[i]);
    }
    return track;
}

const struct rl_active_track *rl_pool_due(const struct rl_pool *pool, int *index, double from_s,
                                          double to_s)
{
    while (*index < pool->count) {
        const struct rl_active_track *track = &pool->track[(*index)++];
        const double end_s = track->train.end_s + RL_PACKET_BITS * track->train.transmission.bit_s;
        if (end_s > from_s && end_s <= to_s) {
            return track;
        }
    }
    return NULL;
}

bool rl_pool_knows(const struct rl_pool *pool, uint16_t id, double begin_s, double end_s,
                   double overlap_s)
{
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if (track->id == id &&
            fmin(end_s, track->train.end_s) - fmax(begin_s, track->train.begin_s) > overlap_s) {
            return true;
        }
    }
    return false;
}

bool rl_pool_is_followed(const struct rl_pool *pool, uint16_t id,
                         const struct rl_packet_train *train)
{
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if (track->id == id && continues(&track->train, train)) {
            return true;
        }
    }
    return false;
}

void rl_pool_interference(const struct rl_pool *pool, uint64_t zones, double since_s, double to_s,
                          uint16_t except, struct rl_interference *interference)
{
    interference->count = 0;
    for (int beside = 0; beside < 2; beside++) {
        for (int i = pool->count - 1; i >= 0; i--) {
            const struct rl_active_track *track = &pool->track[i];
            const struct rl_packet_train *train = &track->train;
            const uint64_t seen = beside ? track->near & ~track->zones : track->zones;
            const bool is_seen = (beside == 0) == ((track->zones & zones) != 0);
            if (track->id != except && (seen & zones) != 0 && is_seen && train->end_s > since_s &&
                train->begin_s < to_s && interference->count < RL_MAX_TRAINS) {
                interference->train[interference->count++] = *train;
            }
        }
    }
}

uint64_t rl_pool_zones(const struct rl_pool *pool, double since_s)
{
    uint64_t zones = 0;
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        zones |= track->train.end_s > since_s ? track->near : 0;
    }
    return zones;
}
