/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Markers that were read lately, in the whole view: they may interfere with others. */
#include "retrolidar_detector_state.h"

#include <math.h>

/* A packet continues a train if it has its phase, and fewer packets were missed. */
static const double MAX_MISSED = 2.0;
/* It is joined to the train if it begins at the same time to this; otherwise there was a pause. */
static const double JOINED_BITS = 2.0 / RL_PHASES;

static uint64_t around(const struct rl_samples *samples, int zone)
{
    uint64_t zones = 0;
    for (int other = 0; other < samples->zones; other++) {
        const bool is_beside = rl_zone_beside(zone, other, samples->sensor.columns);
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

struct rl_packet_train rl_train_of(const struct rl_verdict *verdict)
{
    return (struct rl_packet_train){verdict->transmission, verdict->begin_s, verdict->end_s};
}

/* Whether a train continues another one, or that one continues it. */
static bool continues(const struct rl_packet_train *before, const struct rl_packet_train *now)
{
    const double packet_s = RL_PACKET_BITS * now->transmission.bit_s;
    const double gap_s = fmax(now->begin_s - before->end_s, before->begin_s - now->end_s);
    return gap_s < MAX_MISSED * packet_s && rl_keeps_time(before, now);
}

/* Add packets that were read until a time, to the active track that they continue, if any. */
static const struct rl_active_track *add(struct rl_pool *pool, const struct rl_samples *samples,
                                         const struct rl_reading *reading, double until_s)
{
    const struct rl_verdict *verdict = &reading->verdict;
    struct rl_packet_train train = rl_train_of(verdict);
    train.end_s = until_s;
    struct rl_active_track *track = NULL;
    struct rl_packet_train whole = train;
    for (int i = 0; i < pool->count; i++) {
        struct rl_active_track *before = &pool->track[i];
        const double later = rl_bits_later(&before->train.transmission, &train.transmission);
        if (before->id == verdict->id && continues(&before->train, &train) &&
            fabs(later) < JOINED_BITS) {
            track = before;
            whole.begin_s = fmin(track->train.begin_s, whole.begin_s);
            whole.end_s = fmax(track->train.end_s, whole.end_s);
            whole.transmission.repeats = true;
        }
    }
    if (track == NULL) {
        track = free_slot(pool);
    }
    *track =
        (struct rl_active_track){verdict->id, whole, verdict->word, .zone = reading->zone[0]};
    for (int i = 0; i < reading->zones; i++) {
        track->zones |= (uint64_t)1 << reading->zone[i];
        track->near |= around(samples, reading->zone[i]);
    }
    return track;
}

/* Whether a train and a time overlap by more than a few bits. */
static bool overlaps(const struct rl_packet_train *train, double begin_s, double end_s,
                     double bit_s)
{
    return fmin(end_s, train->end_s) - fmax(begin_s, train->begin_s) > RL_LOOK_BITS * bit_s;
}

bool rl_is_known(const struct rl_detector *detector, uint16_t id, double begin_s, double end_s)
{
    const struct rl_pool *pool = &detector->pool;
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if (track->id == id &&
            overlaps(&track->train, begin_s, end_s, detector->settings.bit_s)) {
            return true;
        }
    }
    return false;
}

bool rl_pool_has(const struct rl_pool *pool, uint64_t zones, const struct rl_packet_train *packet)
{
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if ((track->zones & zones) != 0 && rl_keeps_time(&track->train, packet) &&
            overlaps(&track->train, packet->begin_s, packet->end_s,
                     packet->transmission.bit_s)) {
            return true;
        }
    }
    return false;
}

const struct rl_active_track *rl_pool_followed(const struct rl_pool *pool, uint16_t id,
                                               const struct rl_packet_train *train)
{
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if (track->id == id && continues(&track->train, train)) {
            return track;
        }
    }
    return NULL;
}

bool rl_pool_expects(const struct rl_pool *pool, uint64_t zones,
                     const struct rl_packet_train *packet)
{
    const double near_s = JOINED_BITS * packet->transmission.bit_s;
    int ended = 0, followed = 0;
    for (int i = 0; i < pool->count; i++) {
        const struct rl_packet_train *known = &pool->track[i].train;
        if ((pool->track[i].zones & zones) != 0 && !known->transmission.repeats) {
            ended += fabs(packet->begin_s - known->end_s) < near_s;
            followed += fabs(known->begin_s - packet->end_s) < near_s;
        }
    }
    /* Where two end together, two are expected to begin, and one alone looks like their sum. */
    return ended == 1 || followed == 1;
}

void rl_pool_interference(const struct rl_pool *pool, uint64_t zones, double since_s, uint16_t id,
                          uint16_t other_id, struct rl_interference *interference)
{
    interference->count = 0;
    for (int beside = 0; beside < 2; beside++) {
        for (int i = pool->count - 1; i >= 0; i--) {
            const struct rl_active_track *track = &pool->track[i];
            const struct rl_packet_train *train = &track->train;
            const bool sees = (track->zones & zones) != 0, is_near = (track->near & zones) != 0;
            if ((beside ? is_near && !sees : sees) && track->id != id && track->id != other_id &&
                train->end_s > since_s && interference->count < RL_MAX_TRAINS) {
                interference->train[interference->count++] = *train;
            }
        }
    }
}

void rl_interference_add(struct rl_interference *interference, const struct rl_verdict *verdict)
{
    if (interference->count == RL_MAX_TRAINS) {
        interference->count--;
    }
    interference->train[interference->count++] = rl_train_of(verdict);
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

void rl_add_zone(int32_t *zones, int32_t *count, int zone, const double *strength)
{
    int32_t at = *count;
    if (at < RL_MAX_READ) {
        (*count)++;
    } else if (strength[zones[--at]] >= strength[zone]) {
        return;
    }
    for (; at > 0 && strength[zones[at - 1]] < strength[zone]; at--) {
        zones[at] = zones[at - 1];
    }
    zones[at] = zone;
}

/* Energy of a packet in a zone, fitted along with the interference; 0 without evidence. */
static double energy_in(struct rl_window *window, int zone, const struct rl_verdict *verdict)
{
    rl_window_open(window, zone, false, verdict->begin_s, verdict->end_s);
    const double price = rl_window_follow_gain(window, &verdict->transmission);
    const double likelihood = rl_window_try(window, &verdict->transmission);
    const double gain = window->fit.gain;
    return likelihood - price > window->whitened.null + RL_COST_OF_CHANCE ? gain * gain : 0.0;
}

/* List the zones that saw a packet, the strongest first; of a sum, those with part of its light. */
static int32_t zones_of(struct rl_window *window, const struct rl_verdict *verdict, int32_t *zones)
{
    const struct rl_channel *sum = &window->samples->channel[verdict->channel];
    double most = 0.0, energy[RL_MAX_ZONES];
    int32_t seen = 0;
    zones[0] = sum->zone[0];
    if (sum->zones == 1) {
        return 1;
    }
    for (int i = 0; i < sum->zones; i++) {
        energy[sum->zone[i]] = energy_in(window, sum->zone[i], verdict);
        most = fmax(most, energy[sum->zone[i]]);
    }
    for (int i = 0; i < sum->zones; i++) {
        if (energy[sum->zone[i]] >= RL_MIN_PART * most) {
            rl_add_zone(zones, &seen, sum->zone[i], energy);
        }
    }
    return seen;
}

/* The start of the first packet; of one that repeats, of that which the window first holds most
 * of. It may be before the window.
 */
static double start_of(const struct rl_verdict *verdict)
{
    const struct rl_transmission *transmission = &verdict->transmission;
    const double first_s =
        fmin(RL_PACKET_BITS * transmission->bit_s, verdict->end_s - verdict->begin_s);
    return transmission->repeats ? rl_last_start(transmission, verdict->begin_s + 0.5 * first_s)
                                 : transmission->start_s;
}

void rl_add_reading(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_samples *samples = &detector->samples;
    detector->counts.accepted++;
    if (detector->readings == RL_READINGS) {
        return;
    }
    struct rl_reading *reading = &detector->reading[detector->readings++];
    struct rl_transmission *transmission = &reading->verdict.transmission;
    *reading = (struct rl_reading){.verdict = *verdict};
    reading->zones = zones_of(&detector->window, verdict, reading->zone);
    /* A packet of many frames may have begun before what is held. */
    reading->verdict.begin_s =
        fmax(verdict->begin_s, samples->begin_s[rl_samples_oldest(samples)]);
    /* Whole packets are consumed, so that readings keep time with them; but not many bits that are
     * yet to come.
     */
    const double start_s = start_of(verdict), bit_s = transmission->bit_s;
    const double packets_end_s = start_s + verdict->packets * RL_PACKET_BITS * bit_s;
    const double until_s = packets_end_s < verdict->end_s + RL_LOOK_BITS * bit_s
                               ? packets_end_s
                               : verdict->end_s;
    const struct rl_active_track *track = add(&detector->pool, samples, reading, until_s);
    transmission->start_s = start_s;
    transmission->dark_before = transmission->dark_after = false;
    /* Its light hid packets in the zones beside, too. */
    detector->read_anew |= track->near;
    detector->read_from_s = fmin(detector->read_from_s, reading->verdict.begin_s);
    for (int channel = 0; channel < samples->channels; channel++) {
        if ((samples->channel[channel].mask & track->zones) != 0) {
            detector->read_until_s[channel] = fmax(detector->read_until_s[channel], until_s);
        }
    }
}
