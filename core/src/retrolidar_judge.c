/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_judge.h"

#include "retrolidar_waiting.h"

#include <math.h>
#include <string.h>

enum {
    BEHIND = 3,         /* hits that are judged behind another packet */
    GOING_ON_BITS = 95, /* after a reading, in which its marker may have sent on */
};

/* Share of the evidence in demand that a packet must have which another one hides. */
static const double HIDDEN = 0.7;
/* Evidence that two need besides of which none is read by itself: there are so many pairs. */
static const double COST_OF_PAIR = 8.0;
/* A zone varies by so many times its noise where another packet may be hidden. */
static const double MUCH = 1.5;
/* Readings of one ID that overlap by more are of the same packet. */
static const double SAME_BITS = 4.0;

/* Whether a packet of an ID was read already, by its time. */
static bool is_known(const struct rl_detector *detector, uint16_t id, double start_s, double end_s)
{
    const int first = detector->recents > RL_RECENT ? detector->recents - RL_RECENT : 0;
    for (int i = first; i < detector->recents; i++) {
        const struct rl_recent *recent = &detector->recent[i % RL_RECENT];
        const double overlap_s = fmin(end_s, recent->end_s) - fmax(start_s, recent->start_s);
        if (recent->id == id && overlap_s > SAME_BITS * detector->settings.bit_s) {
            return true;
        }
    }
    return false;
}

static void add_reading(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_samples *samples = &detector->samples;
    detector->counts.accepted++;
    if (detector->readings == RL_READINGS) {
        return;
    }
    /* A packet of many frames may have begun before what is held. */
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    struct rl_reading *reading = &detector->reading[detector->readings++];
    *reading = (struct rl_reading){
        .id = verdict->id,
        .repeats = verdict->sending.repeats,
        .packets = verdict->packets,
        .start_s = verdict->sending.start_s,
        .bit_s = verdict->sending.bit_s,
        .brightening_s = verdict->sending.brightening_s,
        .begin_s = fmax(rl_verdict_begin(verdict), held_s),
        .end_s = verdict->end_s,
        .evidence = verdict->evidence,
        .margin = verdict->margin,
    };
    int zones[RL_MOST_ZONES];
    double gains[RL_MOST_ZONES];
    const int seen = rl_shares_zones(&detector->shares, verdict, zones, gains);
    for (int i = 0; i < seen; i++) {
        int at = i;
        for (; at > 0 && gains[at - 1] < gains[i]; at--) {
        }
        const int zone = zones[i];
        const double gain = gains[i];
        memmove(zones + at + 1, zones + at, (size_t)(i - at) * sizeof *zones);
        memmove(gains + at + 1, gains + at, (size_t)(i - at) * sizeof *gains);
        zones[at] = zone;
        gains[at] = gain;
    }
    reading->zones = seen < RL_MOST_READ ? seen : RL_MOST_READ;
    for (int i = 0; i < reading->zones; i++) {
        reading->zone[i] = zones[i];
    }
    detector->recent[detector->recents++ % RL_RECENT] =
        (struct rl_recent){verdict->id, reading->begin_s, reading->end_s};
    /* What was read is not read again, nor by sums that hold it; but it may go on. */
    for (int other = 0; other < samples->sources; other++) {
        for (int i = 0; i < reading->zones; i++) {
            for (int j = 0; j < samples->source[other].zones; j++) {
                if (samples->source[other].zone[j] == reading->zone[i]) {
                    detector->free_s[other] = fmax(detector->free_s[other], reading->end_s);
                    rl_going_on_add(detector->going_on[other], verdict, gains[i]);
                }
            }
        }
    }
}

static struct rl_verdict decide(struct rl_detector *detector, int source, int packets,
                                const struct rl_hit *hit, const struct rl_hits *hits,
                                double since_s, double to_s)
{
    struct rl_demands demands = detector->demands;
    struct rl_hits rivals = *hits;
    const int pasts = detector->pasts[source];
    for (int i = pasts > RL_PAST ? pasts - RL_PAST : 0; packets == 1 && i < pasts; i++) {
        const struct rl_hit *past = &detector->past[source][i % RL_PAST];
        if (past->start_s + RL_PACKET_BITS * past->bit_s > hit->start_s) {
            rivals.hit[rivals.count++] = *past;
        }
    }
    for (int i = 0; packets == 1 && i < RL_GOING_ON; i++) {
        if (detector->going_on[source][i].id != 0) {
            rivals.hit[rivals.count++] = rl_going_on_hit(&detector->going_on[source][i]);
        }
    }
    if (hit->repeats && packets < detector->settings.max_packets) {
        demands.margin = detector->settings.margin_of_more;
    }
    struct rl_verdict verdict =
        rl_decide(&detector->window, &detector->search.codebook, &demands, source, hit, &rivals,
                  packets, detector->free_s[source], since_s, to_s);
    if (verdict.reason != RL_READ && verdict.reason != RL_EVIDENCE && packets == 1) {
        detector->past[source][detector->pasts[source]++ % RL_PAST] = (struct rl_hit){
            0.0f, verdict.id, verdict.sending.repeats, verdict.sending.start_s,
            verdict.sending.bit_s};
    }
    rl_waiting_note(detector, source, &verdict, to_s);
    if (verdict.reason == RL_READ && !rl_shares_agree(&detector->shares, &verdict)) {
        verdict.reason = RL_NOT_A_WORD;
    }
    if (detector->candidates < 2 * RL_DECISIONS) {
        detector->candidate[detector->candidates++] = (struct rl_candidate){
            verdict.id,
            source,
            packets,
            verdict.reason,
            verdict.sending.start_s,
            verdict.sending.bit_s,
            verdict.evidence,
            verdict.word,
            verdict.margin,
        };
    }
    return verdict;
}

/* Judge a hit while another packet is taken off. */
static struct rl_verdict decide_without(struct rl_detector *detector,
                                        const struct rl_verdict *other, const struct rl_hit *hit,
                                        const struct rl_hits *hits, double to_s)
{
    rl_shares_take_off(&detector->shares, other, false);
    const struct rl_verdict verdict =
        decide(detector, other->source[0], 1, hit, hits, rl_verdict_begin(other), to_s);
    rl_shares_take_off(&detector->shares, other, true);
    return verdict;
}

/* Whether a third marker was read in a source while a hit was sent: the light that it leaves over may
 * look like a packet.
 */
static bool is_beside_a_third(const struct rl_detector *detector, int source, uint16_t other,
                              const struct rl_hit *hit, double to_s)
{
    const double begin_s = hit->repeats ? to_s - RL_PACKET_BITS * hit->bit_s : hit->start_s;
    for (int i = 0; i < RL_GOING_ON; i++) {
        const struct rl_going_on *third = &detector->going_on[source][i];
        if (third->id != 0 && third->id != other && third->id != hit->id &&
            third->end_s > begin_s + RL_OVERLAP_BITS * hit->bit_s) {
            return true;
        }
    }
    return false;
}

/* Look for another packet in the zone of one that was found, which hide each other: each is judged
 * with the other one taken off, twice over. Return whether both are read.
 */
static bool look_behind(struct rl_detector *detector, const struct rl_hits *found, int packets,
                        double from_s, double to_s, struct rl_verdict *before,
                        struct rl_verdict *behind)
{
    const int source = before->source[0];
    struct rl_hits *hits = &detector->behind;
    rl_shares_take_off(&detector->shares, before, false);
    rl_search_look(&detector->search, &source, 1, packets, from_s, to_s,
                   HIDDEN * detector->demands.evidence, 2.0 * detector->most_beyond, hits);
    rl_shares_take_off(&detector->shares, before, true);
    for (int i = 0; i < hits->count && i < BEHIND && detector->decisions_left > 0; i++) {
        const struct rl_hit *hit = &hits->hit[i];
        if (hit->id == before->id ||
            is_beside_a_third(detector, source, before->id, hit, to_s)) {
            continue;
        }
        detector->decisions_left -= 3;
        *behind = decide_without(detector, before, hit, hits, to_s);
        if (behind->evidence < HIDDEN * detector->demands.evidence ||
            behind->reason == RL_INCOMPLETE ||
            is_known(detector, behind->id, rl_verdict_begin(behind), behind->end_s)) {
            continue;
        }
        const struct rl_verdict again =
            decide_without(detector, behind, &found->hit[0], found, to_s);
        if ((again.reason != RL_READ && !before->steady) ||
            again.evidence < before->evidence) {
            continue;
        }
        *behind = decide_without(detector, &again, hit, hits, to_s);
        const double least = detector->demands.evidence + COST_OF_PAIR;
        if (behind->reason == RL_READ &&
            (before->reason == RL_READ ||
             (again.evidence > least && behind->evidence > least))) {
            *before = again;
            return true;
        }
    }
    return false;
}

/* What was read in a zone and is sent on, other than an ID: how it is taken off, if at all, and how
 * the zone varies without it, over what is noise.
 */
static bool goes_on(struct rl_detector *detector, int source, uint16_t except, double to_s,
                    struct rl_verdict *known, double *rest)
{
    for (int i = 0; i < RL_GOING_ON; i++) {
        const struct rl_going_on *going_on = &detector->going_on[source][i];
        if (going_on->id != 0 && going_on->id != except &&
            detector->samples.source[source].zones == 1 &&
            going_on->end_s > to_s - GOING_ON_BITS * detector->settings.bit_s &&
            rl_going_on_is_sent(going_on, &detector->shares, source, to_s, known, rest)) {
            return true;
        }
    }
    return false;
}

void rl_judge_behind(struct rl_detector *detector, int source, double from_s, double to_s)
{
    struct rl_verdict before, behind;
    double rest;
    if (!goes_on(detector, source, 0, to_s, &before, &rest) || rest < MUCH) {
        return;
    }
    const struct rl_hits known = {
        .count = 1,
        .hit = {{0.0f, before.id, true, before.sending.start_s, before.sending.bit_s}}};
    detector->decisions_left--;
    for (int packets = 0; packets <= 1; packets++) {
        if (look_behind(detector, &known, packets, from_s, to_s, &before, &behind)) {
            detector->counts.candidates++;
            add_reading(detector, &behind);
            return;
        }
    }
}

void rl_judge(struct rl_detector *detector, const struct rl_pending *pending, double to_s)
{
    const struct rl_hit *hit = &pending->hits.hit[0];
    const double lasting_s = RL_PACKET_BITS * pending->packets * hit->bit_s;
    const double begin_s = hit->repeats ? to_s - lasting_s : hit->start_s;
    if (begin_s < detector->free_s[pending->source] - RL_OVERLAP_BITS * hit->bit_s ||
        is_known(detector, hit->id, begin_s, begin_s + lasting_s)) {
        return;
    }
    detector->counts.candidates++;
    detector->decisions_left--;
    struct rl_verdict behind, verdict = decide(detector, pending->source, pending->packets, hit,
                                               &pending->hits, -INFINITY, to_s);
    struct rl_verdict known;
    double rest;
    const bool others = goes_on(detector, pending->source, hit->id, to_s, &known, &rest);
    const bool may_hide = pending->packets == 1 &&
                          detector->samples.source[pending->source].zones == 1 &&
                          verdict.reason != RL_INCOMPLETE && verdict.reason != RL_ERASED &&
                          verdict.evidence > HIDDEN * detector->demands.evidence;
    /* Where a marker goes on, others are to be there without it, too. */
    struct rl_verdict first = verdict;
    if (may_hide && look_behind(detector, &pending->hits, 1, to_s, to_s, &first, &behind) &&
        (!others || behind.id == known.id)) {
        verdict = first;
        detector->counts.candidates++;
        add_reading(detector, &behind);
    } else if (others && verdict.reason == RL_READ) {
        verdict = decide_without(detector, &known, hit, &pending->hits, to_s);
    }
    if (verdict.reason == RL_READ) {
        add_reading(detector, &verdict);
    } else {
        detector->counts.rejected[verdict.reason]++;
    }
}
