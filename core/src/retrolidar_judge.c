/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Judge a hit of the search: read it, alone or with another one that it hides, or reject it. */
#include "retrolidar_detector_state.h"

#include <math.h>

/* The sum of zones that a packet may be seen in zone by zone: its channel if that is one, or of
 * those with a zone of its channel the one that varies most; the channel if there is none.
 */
static int sum_of(const struct rl_samples *samples, int channel)
{
    const uint64_t zones = samples->channel[channel].mask;
    double most = 0.0;
    int best = channel;
    for (int sum = samples->zones; sum < samples->channels; sum++) {
        const double varies = sum == channel ? INFINITY : rl_noise_variation(samples, sum);
        if (samples->channel[sum].zones == RL_SUMMED && varies > most &&
            (samples->channel[sum].mask & zones) != 0) {
            most = varies;
            best = sum;
        }
    }
    return best;
}

/* Judge a packet that was rejected again, zone by zone: a marker that crosses zones has another
 * gain in each, and another marker may disturb some of them only. It is read in the zone of which
 * it explains most.
 */
static void decide_by_zone(struct rl_detector *detector, struct rl_case *judged, double since_s,
                           struct rl_verdict *verdict)
{
    struct rl_window *window = &detector->window;
    const int sum = sum_of(&detector->samples, verdict->channel);
    if (detector->samples.channel[sum].zones != RL_SUMMED) {
        return;
    }
    judged->verdict.channel = sum;
    rl_pool_interference(&detector->pool, detector->samples.channel[sum].mask, since_s,
                         verdict->id, verdict->id, &window->interference);
    window->by_zone = true;
    const struct rl_verdict again = rl_decide(judged);
    window->by_zone = false;
    if (again.reason == RL_READ) {
        *verdict = again;
        rl_window_try(window, &again.transmission);
        verdict->channel = window->strongest->channel;
    }
    window->others = 0;
}

/* Judge a hit of those of a channel, beside another packet if `beside` is not NULL. */
static struct rl_verdict decide_as_found(struct rl_detector *detector,
                                         const struct rl_pending *pending,
                                         const struct rl_hit *hit, const struct rl_verdict *beside)
{
    const int channel = pending->channel;
    const int packets = hit->transmission.repeats ? pending->packets : 1;
    struct rl_thresholds thresholds = detector->settings.thresholds;
    struct rl_interference *interference = &detector->window.interference;
    if (hit->transmission.repeats && packets < detector->settings.max_packets) {
        thresholds.margin = thresholds.margin_of_more;
    }
    const double packet_s = RL_PACKET_BITS * hit->transmission.bit_s, to_s = detector->newest_s;
    const double active_s = detector->active_s[channel < detector->samples.zones ? channel : 0];
    const double since_s =
        packets == 1 && channel < detector->samples.zones && active_s < to_s ? active_s : -INFINITY;
    const struct rl_transmission *transmission = &hit->transmission;
    const struct rl_packet_train train = {
        .transmission = *transmission,
        .begin_s = transmission->repeats ? to_s - packets * packet_s : transmission->start_s,
        .end_s = transmission->repeats ? to_s : transmission->start_s + packet_s};
    /* A marker that was read up to three packets before may still be sending. */
    const double known_s = train.begin_s - 3.0 * packet_s;
    const uint64_t zones = detector->samples.channel[channel].mask;
    rl_pool_interference(&detector->pool, zones, known_s, hit->id, hit->id, interference);
    if (beside != NULL) {
        rl_interference_add(interference, beside);
    }
    const struct rl_active_track *before = rl_pool_followed(&detector->pool, hit->id, &train);
    struct rl_case judged = {
        .window = &detector->window,
        .codebook = &detector->search.codebook,
        .thresholds = &thresholds,
        .hits = &pending->hits,
        .read_until_s = detector->read_until_s[channel],
        .since_s = since_s,
        .to_s = to_s,
        .follows = before != NULL,
        .is_expected = before != NULL || rl_pool_expects(&detector->pool, zones, &train),
        .word_before = before != NULL ? before->word : 0.0,
        .verdict = {channel, packets, hit->id, .transmission = *transmission},
    };
    const struct rl_case given = judged;
    struct rl_verdict verdict = rl_decide(&judged);
    if (beside == NULL && verdict.evidence > detector->min_nats &&
        (verdict.reason == RL_EVIDENCE || verdict.reason == RL_NOT_A_WORD ||
         verdict.reason == RL_MARGIN)) {
        judged = given;
        decide_by_zone(detector, &judged, known_s, &verdict);
    }
    return verdict;
}

/* The last packet of a stretch that has ended, as a lone one. */
static struct rl_hit last_ended(const struct rl_verdict *verdict, double to_s)
{
    const struct rl_transmission *transmission = &verdict->transmission;
    struct rl_hit hit = {(float)verdict->evidence, verdict->id, *transmission};
    hit.transmission.repeats = false;
    hit.transmission.start_s =
        rl_last_start(transmission, to_s - RL_PACKET_BITS * transmission->bit_s);
    return hit;
}

/* Judge a hit. If a stretch may not repeat, judge the last packet that ended in it. */
static struct rl_verdict decide(struct rl_detector *detector, const struct rl_pending *pending,
                                const struct rl_hit *hit, const struct rl_verdict *beside)
{
    const struct rl_verdict verdict = decide_as_found(detector, pending, hit, beside);
    if (verdict.reason != RL_INCOMPLETE || !hit->transmission.repeats) {
        return verdict;
    }
    const struct rl_hit ended = last_ended(&verdict, detector->newest_s);
    const double start_s = ended.transmission.start_s;
    return rl_is_known(detector, ended.id, start_s,
                       start_s + RL_PACKET_BITS * ended.transmission.bit_s)
               ? verdict
               : decide_as_found(detector, pending, &ended, beside);
}

/* Subtract a packet and those read before from a zone, and search the rest, if it varies by more
 * than noise: for any stretch, or else for a packet that is sent together with a lone one. Return
 * what is found.
 */
static struct rl_pending search_without(struct rl_detector *detector, const struct rl_verdict *one)
{
    struct rl_pending found = {one->channel, one->packets, -INFINITY, {.count = 0}};
    const int channel = one->channel, packets = one->packets;
    const double bit_s = detector->settings.bit_s, packet_s = RL_PACKET_BITS * bit_s;
    const double to_s = detector->newest_s;
    const double from_s = to_s - RL_SEARCH_BITS * bit_s - (packets - 1) * packet_s;
    const double since_s = to_s - RL_CONTINUES_BITS * bit_s;
    if (rl_residual_subtract(detector, channel, since_s, from_s, one) > RL_ACTIVE) {
        struct rl_sought sought = {.packets = packets,
                                   .from_s = to_s,
                                   .to_s = to_s,
                                   .since_s = -INFINITY,
                                   .least = detector->min_nats,
                                   .max_llr_deficit = 2.0 * detector->max_llr_deficit};
        rl_search_channels(&detector->search, &sought, &channel, 1, &found.hits);
        if (found.hits.count == 0 && !one->transmission.repeats) {
            sought.packets = 0;
            sought.from_s = one->end_s - bit_s / RL_PHASES;
            sought.to_s = fmin(one->end_s + bit_s / RL_PHASES, to_s);
            rl_search_channels(&detector->search, &sought, &channel, 1, &found.hits);
        }
    }
    rl_residual_restore(detector, channel);
    return found;
}

/* Look for another packet in the zone of one, as they hide each other: the other is the best one
 * without the first, then the first is sought again without the other, and each is judged with the
 * other one beside it. Return whether both are read.
 */
static bool judge_pair(struct rl_detector *detector, struct rl_verdict *one,
                       struct rl_verdict *other)
{
    const struct rl_pending behind = search_without(detector, one);
    for (int i = 0; i < behind.hits.count && i < RL_TRIED && detector->decisions_left > 0; i++) {
        const struct rl_hit *hit = &behind.hits.hit[i];
        if (hit->id == one->id) {
            continue;
        }
        detector->decisions_left -= 3;
        *other = decide(detector, &behind, hit, one);
        if (other->evidence < detector->min_nats || other->reason == RL_INCOMPLETE ||
            rl_is_known(detector, other->id, other->begin_s, other->end_s)) {
            continue;
        }
        const struct rl_pending found = search_without(detector, other);
        if (found.hits.count == 0 || found.hits.hit[0].id == other->id) {
            continue;
        }
        const struct rl_verdict again = decide(detector, &found, &found.hits.hit[0], other);
        if (again.reason != RL_READ ||
            rl_is_known(detector, again.id, again.begin_s, again.end_s)) {
            continue;
        }
        *other = decide(detector, &behind, hit, &again);
        const double margin =
            other->reason == RL_READ ? rl_pair_margin(detector, &again, other) : 0.0;
        if (margin >= detector->settings.thresholds.margin) {
            *one = again;
            one->margin = fmin(one->margin, margin);
            other->margin = fmin(other->margin, margin);
            return true;
        }
    }
    return false;
}

void rl_judge(struct rl_detector *detector, const struct rl_pending *pending)
{
    const struct rl_hit *hit = &pending->hits.hit[0];
    const struct rl_transmission *transmission = &hit->transmission;
    const double lasting_s = RL_PACKET_BITS * pending->packets * transmission->bit_s;
    const double to_s = detector->newest_s;
    const double begin_s = transmission->repeats ? fmax(to_s - lasting_s, pending->since_s)
                                                 : transmission->start_s;
    const double end_s = transmission->repeats ? to_s : begin_s + lasting_s;
    if (rl_is_known(detector, hit->id, begin_s, end_s)) {
        return;
    }
    detector->counts.candidates++;
    detector->decisions_left--;
    struct rl_verdict other, verdict = decide(detector, pending, hit, NULL);
    const bool may_hide = pending->since_s < begin_s &&
                          detector->samples.channel[pending->channel].zones == 1 &&
                          verdict.reason != RL_INCOMPLETE && verdict.reason != RL_ERASED &&
                          verdict.reason != RL_MARGIN && verdict.evidence > detector->min_nats;
    if (verdict.reason == RL_READ) {
        const double margin = rl_pair_margin_beside_known(detector, &verdict);
        verdict.margin = fmin(verdict.margin, margin);
        if (verdict.margin < detector->settings.thresholds.margin) {
            verdict.reason = RL_MARGIN;
        }
    }
    if (may_hide && judge_pair(detector, &verdict, &other)) {
        detector->counts.candidates++;
        detector->candidate[detector->candidates++] = other;
        rl_add_reading(detector, &other);
    }
    detector->candidate[detector->candidates++] = verdict;
    if (verdict.reason == RL_READ) {
        rl_add_reading(detector, &verdict);
    } else {
        detector->counts.rejected[verdict.reason]++;
    }
}
