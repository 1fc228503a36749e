/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What is searched after each frame: channels in which a packet may have ended or appeared. */
#include "retrolidar_detector_state.h"

#include <math.h>

enum {
    STRETCH_BITS = 2, /* between two searches of the last packet of each channel */
    SEARCHED_BITS = 2 * RL_PACKET_BITS + RL_CONTINUES_BITS, /* that the residual is searched back */
    MAX_WORDS = 300, /* shortlist entries per frame that are compared with all words, at most */
};
/* How many packets that repeat are added up, one after the other. */
static const int COMBINED[] = {1, 2, 3, 5, RL_MAX_PACKETS};

/* Search channels for packets until now; since_s: earlier samples are left out. */
static void search(struct rl_detector *detector, const int *channels, int count, int packets,
                   double from_s, double since_s)
{
    struct rl_hits *hits = detector->hits;
    if (count == 0) {
        return;
    }
    const struct rl_sought sought = {packets, from_s, detector->newest_s, since_s,
                                     detector->min_nats, detector->max_llr_deficit};
    rl_search_channels(&detector->search, &sought, channels, count, hits);
    for (int i = 0; i < count; i++) {
        if (hits[i].count > 0 && detector->pendings < RL_MAX_PENDING) {
            detector->pending[detector->pendings++] =
                (struct rl_pending){channels[i], packets > 0 ? packets : 1, since_s, hits[i]};
        }
    }
}

/* List the channels without a reading in the last `bits`: of those that vary, or all single zones.
 */
static int ready(const struct rl_detector *detector, double bits, bool that_vary, int *channels)
{
    const struct rl_samples *samples = &detector->samples;
    const double since_s = detector->newest_s - bits * detector->settings.bit_s;
    int count = 0;
    for (int channel = 0; channel < samples->channels; channel++) {
        const int zones = samples->channel[channel].zones;
        if (detector->read_until_s[channel] <= since_s &&
            (that_vary ? rl_noise_variation(samples, channel) > RL_ACTIVE : zones == 1)) {
            channels[count++] = channel;
        }
    }
    return count;
}

/* Keep the channels in which, since the last packet read (or since time 0), so many bits became
 * complete since `from_s`.
 */
static int due(const struct rl_detector *detector, int *channels, int count, double bits,
               double from_s)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const double since_s =
            fmax(detector->read_until_s[channels[i]], 0.0) + bits * detector->settings.bit_s;
        if (since_s > from_s && since_s <= detector->newest_s) {
            channels[kept++] = channels[i];
        }
    }
    return kept;
}

/* Subtract packets that were read lately from the zones they were read in, from zones beside them
 * that they explain, and from sums of these. Return the zones; rest: the variance that is left in
 * each of their channels, over that of the noise.
 *
 * since_s: packets that ended more than RL_CONTINUES_BITS earlier are not subtracted
 */
static uint64_t subtract_read(struct rl_detector *detector, double since_s, double *rest)
{
    const struct rl_samples *samples = &detector->samples;
    const double bit_s = detector->settings.bit_s;
    const double forgotten_s = detector->newest_s - SEARCHED_BITS * bit_s;
    uint64_t zones = rl_pool_zones(&detector->pool, forgotten_s);
    for (int zone = 0; zone < samples->zones; zone++) {
        const uint64_t own = samples->channel[zone].mask;
        if (rl_noise_variation(samples, zone) <= RL_ACTIVE) {
            zones &= ~own;
        }
        if ((zones & own) != 0) {
            rest[zone] =
                rl_residual_subtract(detector, zone, since_s - RL_CONTINUES_BITS * bit_s,
                                     since_s - RL_SEARCH_BITS * bit_s, NULL);
            if (detector->read_until_s[zone] <= forgotten_s &&
                rest[zone] > RL_MOST * rl_noise_variation(samples, zone)) {
                rl_residual_restore(detector, zone);
                zones &= ~own;
            }
        }
    }
    for (int sum = samples->zones; sum < samples->channels; sum++) {
        if ((samples->channel[sum].mask & zones) != 0) {
            rest[sum] = rl_residual_sum(detector, sum);
        }
    }
    return zones;
}

/* Subtract packets that were read lately, and search for others (successive interference
 * cancellation). A packet that ended during another one is found after that other one was read.
 *
 * from_s: packets that ended earlier have been searched with the same ones subtracted
 */
static void search_residual(struct rl_detector *detector, double from_s)
{
    const struct rl_samples *samples = &detector->samples;
    const double forgotten_s = detector->newest_s - SEARCHED_BITS * detector->settings.bit_s;
    const double anew_s = fmin(from_s, fmax(detector->read_from_s, forgotten_s));
    double rest[RL_MAX_CHANNELS];
    const uint64_t subtracted = subtract_read(detector, anew_s, rest);
    for (int again = 0; again < 2; again++) {
        int channels[RL_MAX_CHANNELS], count = 0;
        for (int channel = 0; channel < samples->channels; channel++) {
            const uint64_t zones = samples->channel[channel].mask;
            const bool is_anew = (zones & detector->read_anew) != 0;
            if ((zones & subtracted) != 0 && rest[channel] > RL_ACTIVE && is_anew == again) {
                channels[count++] = channel;
            }
        }
        const double ended_s = again ? anew_s : from_s;
        search(detector, channels, count, 0, ended_s, -INFINITY);
        search(detector, channels, count, 1, ended_s, -INFINITY);
    }
    for (int channel = 0; channel < samples->channels; channel++) {
        if ((samples->channel[channel].mask & subtracted) != 0) {
            rl_residual_restore(detector, channel);
        }
    }
    detector->read_anew = 0;
    detector->read_from_s = INFINITY;
}

/* Judge the next packet of each active track, without a search. */
static void judge_next(struct rl_detector *detector, double from_s)
{
    const double to_s = detector->newest_s;
    for (int i = 0; i < detector->pool.count && detector->decisions_left > 0; i++) {
        const struct rl_active_track *track = &detector->pool.track[i];
        struct rl_transmission next = track->train.transmission;
        const double packet_s = RL_PACKET_BITS * next.bit_s;
        const double end_s = track->train.end_s + packet_s;
        if (!(end_s > from_s && end_s <= to_s)) {
            continue;
        }
        /* The packet that the newest stretch of its length begins in. */
        next.start_s = rl_last_start(&next, to_s - packet_s);
        next.repeats = true;
        const struct rl_pending pending = {
            .channel = track->zone,
            .packets = 1,
            .since_s = -INFINITY,
            .hits = {.count = 1, .hit = {{0.0f, track->id, next}}}};
        rl_judge(detector, &pending);
    }
}

/* Search zones where something appeared lately, and nothing was read since, in the samples since
 * then only.
 */
static void search_appeared(struct rl_detector *detector)
{
    const double bit_s = detector->settings.bit_s, to_s = detector->newest_s;
    const double min_bits =
        rl_decide_min_bits(&detector->search.codebook, &detector->settings.thresholds);
    for (int zone = 0; zone < detector->samples.zones; zone++) {
        const double since_s = detector->active_s[zone], bits = (to_s - since_s) / bit_s;
        if (detector->read_until_s[zone] < since_s && bits >= min_bits &&
            bits < RL_PACKET_BITS) {
            search(detector, &zone, 1, 1, to_s, since_s);
        }
    }
}

/* Note since when zones vary by more than their noise: from the end of the newest exposure on, as
 * that has seen only a part of what has just appeared.
 */
static void note_active(struct rl_detector *detector)
{
    for (int zone = 0; zone < detector->samples.zones; zone++) {
        double *since_s = &detector->active_s[zone];
        const bool is_active = rl_noise_variation(&detector->samples, zone) > RL_ACTIVE;
        *since_s = !is_active ? INFINITY : *since_s == INFINITY ? detector->newest_s : *since_s;
    }
}

/* Whether a multiple of `every_s` lies within (from_s, to_s]. */
static bool comes(double every_s, double from_s, double to_s)
{
    return floor(to_s / every_s) > floor(from_s / every_s);
}

/* How promising a candidate is. */
static float rank(const struct rl_detector *detector, int index)
{
    const struct rl_pending *pending = &detector->pending[index];
    const bool is_sum = detector->samples.channel[pending->channel].zones > 1;
    /* A sum is judged after zones that explain nearly as much. */
    return (is_sum ? (float)RL_MOST : 1.0f) * pending->hits.hit[0].nats;
}

void rl_process_frame(struct rl_detector *detector)
{
    const struct rl_samples *samples = &detector->samples;
    const double bit_s = detector->settings.bit_s;
    const double to_s = samples->end_s[samples->count - 1];
    const double from_s = fmax(detector->newest_s, to_s - RL_PACKET_BITS * bit_s);
    const double held_s = to_s - samples->begin_s[rl_samples_oldest(samples)];
    int channels[RL_MAX_CHANNELS];
    detector->pendings = 0;
    detector->search.words_left = MAX_WORDS;
    detector->search.dropped = false;
    detector->decisions_left = RL_DECISIONS;
    detector->newest_s = to_s;
    note_active(detector);
    const double packet_bits = RL_PACKET_BITS * (1.0 - RL_MAX_SKEW) - RL_OVERLAP_BITS;
    if (held_s < (RL_PACKET_BITS - 0.5) * bit_s) {
        return;
    }
    judge_next(detector, from_s);
    int count = ready(detector, packet_bits, true, channels);
    search(detector, channels, count, 0, from_s, -INFINITY);
    if (comes(STRETCH_BITS * bit_s, from_s, to_s)) {
        search(detector, channels, count, 1, from_s, -INFINITY);
    }
    const double slot_s = RL_LOOK_BITS * bit_s;
    const int64_t slot = (int64_t)floor(to_s / slot_s);
    const bool is_new_slot = comes(slot_s, from_s, to_s);
    /* Several packets are searched as soon as so many have come, and then in turn. */
    const int rounds = sizeof COMBINED / sizeof *COMBINED;
    for (int round = 1; round < rounds && COMBINED[round] <= detector->settings.max_packets;
         round++) {
        const double bits = RL_PACKET_BITS * COMBINED[round] * (1.0 + RL_MAX_SKEW) + 1.0;
        if (held_s < bits * bit_s || bits * bit_s > samples->kept * samples->period_s) {
            break;
        }
        count = ready(detector, bits - RL_OVERLAP_BITS, false, channels);
        if (!is_new_slot || slot % (RL_PACKET_BITS / RL_LOOK_BITS + 1) != round) {
            count = due(detector, channels, count, bits, from_s);
        }
        search(detector, channels, count, COMBINED[round], from_s, -INFINITY);
    }
    if (comes(bit_s, from_s, to_s)) {
        search_appeared(detector);
    }
    if (is_new_slot) {
        search_residual(detector, floor(from_s / slot_s) * slot_s);
    }
    while (detector->pendings > 0 && detector->decisions_left > 0) {
        int best = 0;
        for (int i = 1; i < detector->pendings; i++) {
            if (rank(detector, i) > rank(detector, best)) {
                best = i;
            }
        }
        const struct rl_pending pending = detector->pending[best];
        detector->pending[best] = detector->pending[--detector->pendings];
        rl_judge(detector, &pending);
    }
    rl_judge_expected(detector, from_s);
    detector->counts.overloads += detector->pendings > 0 || detector->search.dropped;
}
