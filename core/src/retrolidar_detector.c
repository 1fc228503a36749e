/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_detector.h"

#include "retrolidar_noise.h"
#include "retrolidar_packet.h"
#include "retrolidar_target.h"
#include "retrolidar_track.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum {
    READINGS = 32,   /* that one frame may bring */
    RECENT = 64,     /* readings that are remembered, not to be told twice */
    FOLDS = 5,
    LOOK_BITS = 4,   /* between two looks at stretches of one packet */
    WORDS_A_FRAME = 300, /* that are searched, and ... */
    BEHIND = 3, /* hits that are judged behind another packet */
    DECISIONS_A_FRAME = 12, /* ... candidates that are judged, at the most */
};
static const int FOLD[FOLDS] = {1, 2, 3, 5, 8};
/* A source that varies by less than so many times its noise holds no packet by itself. */
static const double ACTIVE = 1.5;
/* Share of the evidence in demand that a coarse template must find. */
static const double COARSE = 0.7;
/* Share of the evidence in demand that a packet must have which another one hides. */
static const double HIDDEN = 0.7;
/* Evidence that two need besides of which none is read by itself: there are so many pairs. */
static const double COST_OF_PAIR = 8.0;
/* Share of how zones vary that a packet must explain which their sum shows. */
static const double LEAST_IN_ZONES = 0.7;
/* A zone has a part in a sum if the packet explains this share of what it does where most. */
static const double LEAST_PART = 0.1;
/* Sums are asked after zones that explain nearly as much. */
static const float SUM_SHARE = 0.8f;
/* Bits by which a packet may begin before the one before it has ended. */
static const double OVERLAP_BITS = 1.5;
/* Bits before a stretch that a search of it may reach. */
static const double MARGIN_BITS = 4.0;
/* Readings of one ID that overlap by more are of the same packet. */
static const double SAME_BITS = 4.0;
/* Search finds no word where others are so much better [nats]. */
static const double BEYOND_COARSE = 6.0;
static const double MOST_SKEW = 0.03;

struct recent {
    uint16_t id;
    double start_s, end_s;
};

struct pending {
    int source, packets;
    struct rl_hits hits;
};

struct rl_detector {
    struct rl_settings settings;
    struct rl_samples samples;
    struct rl_search search;
    struct rl_window window;
    struct rl_demands demands;
    struct rl_counts counts;
    int64_t last_ns;
    double looked_s, learnt_s, begun_s;
    int64_t turn;
    double free_s[RL_MOST_SOURCES];
    struct recent recent[RECENT];
    int recents;
    int readings, decisions_left;
    struct rl_reading reading[READINGS];
    int candidates;
    struct rl_candidate candidate[2 * DECISIONS_A_FRAME];
    struct rl_hits hits[RL_MOST_SOURCES], behind;
    struct rl_hit past[RL_MOST_SOURCES][RL_PAST]; /* judged and not read, as rivals of later ones */
    int pasts[RL_MOST_SOURCES];
    struct pending pending[RL_MOST_SOURCES * 2];
    int pendings;
    float *taken; /* signals before a packet was taken off them */
    double *light;
};

struct rl_detector *rl_detector_create(const struct rl_settings *settings, const uint16_t *ids,
                                       int32_t count)
{
    const struct rl_noise_law law = {settings->noise_floor, settings->noise_slope,
                                     settings->noise_ambient};
    const int rows = settings->kept;
    const int64_t head = ((int64_t)sizeof(struct rl_detector) + 15) / 16 * 16;
    const int64_t samples = (rl_samples_bytes(settings->rows, settings->columns, rows) + 15) / 16 * 16;
    const int64_t search = (rl_search_bytes(rows) + 15) / 16 * 16;
    const int64_t window = (rl_window_bytes(rows) + 15) / 16 * 16;
    const int64_t light = (int64_t)rows * (int64_t)sizeof(double);
    const int64_t taken = (int64_t)rows * RL_MOST_ZONES_TOGETHER * (int64_t)sizeof(float);
    char *memory = calloc(1, (size_t)(head + samples + search + window + light + taken));
    if (memory == NULL) {
        return NULL;
    }
    struct rl_detector *detector = (struct rl_detector *)memory;
    detector->settings = *settings;
    detector->demands = (struct rl_demands){
        .evidence = settings->evidence,
        .wandering = settings->wandering,
        .word = settings->word,
        .margin = settings->margin,
        .bit_s = settings->bit_s,
        .most_skew = MOST_SKEW,
    };
    memory += head;
    rl_samples_start(&detector->samples, settings->rows, settings->columns, rows, memory, &law,
                     settings->bit_s);
    memory += samples;
    rl_codebook_start(&detector->search.codebook, ids, count);
    rl_search_start(&detector->search, &detector->samples, settings->bit_s, MOST_SKEW, memory);
    memory += search;
    rl_window_start(&detector->window, &detector->samples, rows, memory);
    memory += window;
    detector->light = (double *)memory;
    detector->taken = (float *)(memory + light);
    return detector;
}

void rl_detector_destroy(struct rl_detector *detector)
{
    free(detector);
}

static void begin_anew(struct rl_detector *detector, int64_t stamp_ns)
{
    rl_samples_clear(&detector->samples, stamp_ns);
    detector->recents = 0;
    detector->looked_s = detector->learnt_s = -INFINITY;
    detector->begun_s = 0.0;
    for (int source = 0; source < RL_MOST_SOURCES; source++) {
        detector->free_s[source] = -INFINITY;
        detector->pasts[source] = 0;
    }
}

/* Whether a packet of an ID was read already, by its time. */
static bool is_known(const struct rl_detector *detector, uint16_t id, double start_s, double end_s)
{
    const int first = detector->recents > RECENT ? detector->recents - RECENT : 0;
    for (int i = first; i < detector->recents; i++) {
        const struct recent *recent = &detector->recent[i % RECENT];
        const double overlap_s = fmin(end_s, recent->end_s) - fmax(start_s, recent->start_s);
        if (recent->id == id && overlap_s > SAME_BITS * detector->settings.bit_s) {
            return true;
        }
    }
    return false;
}

/* Rows of the samples that a verdict is of, and the light of its packet in each. One that repeats was
 * sent some bits before, too, at which a search for others looks.
 */
static int light_of(struct rl_detector *detector, const struct rl_verdict *verdict, int *first)
{
    const struct rl_samples *samples = &detector->samples;
    const double before_s = verdict->sending.repeats ? MARGIN_BITS * verdict->sending.bit_s : 0.0;
    *first = rl_samples_row(samples, rl_verdict_begin(verdict) - before_s);
    int rows = rl_samples_row(samples, verdict->end_s) + 1;
    rows = (rows < samples->count ? rows : samples->count) - *first;
    rows = rows < samples->kept ? rows : samples->kept;
    rl_template(&verdict->sending, samples->begin_s + *first, samples->end_s + *first, rows,
                detector->light);
    return rows;
}

/* How much of how a zone varies from sample to sample a packet explains if its gain may change. */
static struct rl_track track(struct rl_detector *detector, int zone, int first, int rows,
                    double gain[RL_KNOTS])
{
    const struct rl_samples *samples = &detector->samples;
    struct rl_window *window = &detector->window;
    double sum = 0.0;
    rl_target_column(samples, zone, first, rows, window->signal, window->valid, window->scratch);
    for (int row = 0; row < rows; row++) {
        sum += (double)window->signal[row];
    }
    const double noise = samples->noise_scale * rl_noise_variance(samples, zone, sum / rows);
    return rl_track_fit(window->signal, window->valid, detector->light, rows, noise, gain);
}

/* The zones that saw a packet, and how strongly; of a sum those with a part in it. */
static int zones_of(struct rl_detector *detector, const struct rl_verdict *verdict, int *zones,
                    double *gains)
{
    const struct rl_source *sum = &detector->samples.source[verdict->source[0]];
    if (sum->zones == 1) {
        for (int i = 0; i < verdict->sources; i++) {
            zones[i] = verdict->source[i];
            gains[i] = verdict->fit[i].gain;
        }
        return verdict->sources;
    }
    int first, seen = 0;
    double most = 0.0, explained[RL_MOST_ZONES];
    const int rows = light_of(detector, verdict, &first);
    for (int i = 0; i < sum->zones; i++) {
        double gain[RL_KNOTS];
        explained[i] = track(detector, sum->zone[i], first, rows, gain).explained;
        most = fmax(most, explained[i]);
    }
    for (int i = 0; i < sum->zones; i++) {
        if (explained[i] >= LEAST_PART * most) {
            zones[seen] = sum->zone[i];
            gains[seen++] = explained[i];
        }
    }
    return seen;
}

static void add_reading(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_samples *samples = &detector->samples;
    detector->counts.accepted++;
    if (detector->readings == READINGS) {
        return;
    }
    struct rl_reading *reading = &detector->reading[detector->readings++];
    memset(reading, 0, sizeof *reading);
    reading->id = verdict->id;
    reading->repeats = verdict->sending.repeats;
    reading->packets = verdict->packets;
    reading->start_s = verdict->sending.start_s;
    reading->bit_s = verdict->sending.bit_s;
    reading->brightening_s = verdict->sending.brightening_s;
    /* A packet of many frames may have begun before what is held. */
    const int oldest = samples->count > samples->kept ? samples->count - samples->kept : 0;
    reading->begin_s = fmax(rl_verdict_begin(verdict), samples->begin_s[oldest]);
    reading->end_s = verdict->end_s;
    reading->evidence = verdict->evidence;
    reading->margin = verdict->margin;
    int zones[RL_MOST_ZONES];
    double gains[RL_MOST_ZONES];
    const int seen = zones_of(detector, verdict, zones, gains);
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
    detector->recent[detector->recents++ % RECENT] =
        (struct recent){verdict->id, reading->begin_s, reading->end_s};
    /* What was read is not read again, nor by sums that hold it. */
    for (int other = 0; other < samples->sources; other++) {
        for (int i = 0; i < reading->zones; i++) {
            for (int j = 0; j < samples->source[other].zones; j++) {
                if (samples->source[other].zone[j] == reading->zone[i]) {
                    detector->free_s[other] = fmax(detector->free_s[other], reading->end_s);
                }
            }
        }
    }
}

/* Take a packet off the samples of its sources, or put it back. */
static void take_off(struct rl_detector *detector, const struct rl_verdict *verdict, bool back)
{
    struct rl_samples *samples = &detector->samples;
    int first;
    const int rows = light_of(detector, verdict, &first);
    for (int i = 0; i < verdict->sources; i++) {
        double gain[RL_KNOTS];
        if (!back) {
            track(detector, verdict->source[i], first, rows, gain);
        }
        for (int row = 0; row < rows; row++) {
            float *signal = samples->signal + (size_t)(first + row) * (size_t)samples->width +
                            verdict->source[i];
            float *taken = detector->taken + (size_t)row * RL_MOST_ZONES_TOGETHER + i;
            if (back) {
                *signal = *taken;
            } else {
                *taken = *signal;
                *signal += (float)(rl_track_gain(gain, row, rows) * (1.0 - detector->light[row]));
            }
        }
    }
}

/* Whether a packet that a sum of zones shows is what these zones see: two that each see another
 * packet make a third one.
 */
static bool is_in_zones(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_source *sum = &detector->samples.source[verdict->source[0]];
    int first;
    const int rows = light_of(detector, verdict, &first);
    double explained = 0.0, all = 0.0;
    for (int i = 0; sum->zones > 1 && i < sum->zones; i++) {
        double gain[RL_KNOTS];
        const struct rl_track seen = track(detector, sum->zone[i], first, rows, gain);
        explained += seen.explained;
        all += seen.all;
    }
    return sum->zones == 1 || explained > LEAST_IN_ZONES * all;
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
    if (hit->repeats && packets < detector->settings.max_packets) {
        demands.margin = detector->settings.margin_of_more;
    }
    struct rl_verdict verdict =
        rl_decide(&detector->window, &detector->search.codebook, &demands, source, hit, &rivals,
                  packets, detector->free_s[source], since_s, to_s);
    if (verdict.reason != RL_REASONS && verdict.reason != RL_EVIDENCE && packets == 1) {
        detector->past[source][detector->pasts[source]++ % RL_PAST] = (struct rl_hit){
            0.0f, verdict.id, verdict.sending.repeats, verdict.sending.start_s,
            verdict.sending.bit_s};
    }
    if (verdict.reason == RL_REASONS && !is_in_zones(detector, &verdict)) {
        verdict.reason = RL_NOT_A_WORD;
    }
    if (detector->candidates < 2 * DECISIONS_A_FRAME) {
        detector->candidate[detector->candidates++] = (struct rl_candidate){
            verdict.id,      source,
            packets,         verdict.reason,
            verdict.sending.start_s, verdict.sending.bit_s,
            verdict.evidence, verdict.word,
            verdict.margin,
        };
    }
    return verdict;
}

/* Judge a hit while another packet is taken off. */
static struct rl_verdict decide_without(struct rl_detector *detector, const struct rl_verdict *other,
                                        const struct rl_hit *hit, const struct rl_hits *hits,
                                        double to_s)
{
    take_off(detector, other, false);
    const struct rl_verdict verdict =
        decide(detector, other->source[0], 1, hit, hits, rl_verdict_begin(other), to_s);
    take_off(detector, other, true);
    return verdict;
}

/* Look for another packet in the zone of one that was found, which hide each other: each is judged
 * with the other one taken off, twice over. Return whether both are read.
 */
static bool look_behind(struct rl_detector *detector, const struct pending *pending, double to_s,
                        struct rl_verdict *before, struct rl_verdict *behind)
{
    const int source = before->source[0];
    struct rl_hits *hits = &detector->behind;
    take_off(detector, before, false);
    rl_search_look(&detector->search, &source, 1, 1, to_s, to_s,
                   HIDDEN * detector->demands.evidence,
                   2.0 * (BEYOND_COARSE + detector->demands.word), hits);
    take_off(detector, before, true);
    for (int i = 0; i < hits->count && i < BEHIND && detector->decisions_left > 0; i++) {
        const struct rl_hit *hit = &hits->hit[i];
        if (hit->id == before->id) {
            continue;
        }
        detector->decisions_left -= 3;
        *behind = decide_without(detector, before, hit, hits, to_s);
        if (behind->evidence < HIDDEN * detector->demands.evidence ||
            is_known(detector, behind->id, rl_verdict_begin(behind), behind->end_s)) {
            continue;
        }
        const struct rl_verdict again = decide_without(detector, behind, &pending->hits.hit[0],
                                                       &pending->hits, to_s);
        if (again.reason != RL_REASONS || again.evidence < before->evidence) {
            continue;
        }
        *behind = decide_without(detector, &again, hit, hits, to_s);
        const double least = detector->demands.evidence + COST_OF_PAIR;
        if (behind->reason == RL_REASONS &&
            (before->reason == RL_REASONS ||
             (again.evidence > least && behind->evidence > least))) {
            *before = again;
            return true;
        }
    }
    return false;
}

/* Judge the best hit of a source, and what it may hide. */
static void judge(struct rl_detector *detector, const struct pending *pending, double to_s)
{
    const struct rl_hit *hit = &pending->hits.hit[0];
    const double begin_s =
        hit->repeats ? to_s - RL_PACKET_BITS * pending->packets * hit->bit_s : hit->start_s;
    if (begin_s < detector->free_s[pending->source] - OVERLAP_BITS * hit->bit_s ||
        is_known(detector, hit->id, begin_s, begin_s + RL_PACKET_BITS * pending->packets * hit->bit_s)) {
        return;
    }
    detector->counts.candidates++;
    detector->decisions_left--;
    struct rl_verdict behind, verdict = decide(detector, pending->source, pending->packets, hit,
                                               &pending->hits, -INFINITY, to_s);
    const bool may_hide = pending->packets == 1 &&
                          detector->samples.source[pending->source].zones == 1 &&
                          verdict.reason != RL_INCOMPLETE && verdict.reason != RL_ERASED &&
                          verdict.evidence > HIDDEN * detector->demands.evidence;
    if (may_hide && look_behind(detector, pending, to_s, &verdict, &behind)) {
        detector->counts.candidates++;
        add_reading(detector, &behind);
    }
    if (verdict.reason == RL_REASONS) {
        add_reading(detector, &verdict);
    } else {
        detector->counts.refused[verdict.reason]++;
    }
}

static void search(struct rl_detector *detector, const int *sources, int count, int packets,
                   double from_s, double to_s)
{
    struct rl_hits *hits = detector->hits;
    if (count == 0) {
        return;
    }
    rl_search_look(&detector->search, sources, count, packets, from_s, to_s,
                   COARSE * detector->demands.evidence, BEYOND_COARSE + detector->demands.word, hits);
    for (int i = 0; i < count; i++) {
        if (hits[i].count > 0 && detector->pendings < RL_MOST_SOURCES * 2) {
            detector->pending[detector->pendings++] =
                (struct pending){sources[i], packets > 0 ? packets : 1, hits[i]};
        }
    }
}

/* Sources that have not been read for so long, and are active if that is asked. */
static int ready(const struct rl_detector *detector, double bits, double to_s, bool active,
                 int most_zones, int *sources)
{
    int count = 0;
    const double since_s = to_s - bits * detector->settings.bit_s;
    for (int source = 0; source < detector->samples.sources; source++) {
        if (detector->free_s[source] <= since_s &&
            detector->samples.source[source].zones <= most_zones &&
            (!active || rl_noise_variation(&detector->samples, source) > ACTIVE)) {
            sources[count++] = source;
        }
    }
    return count;
}

/* Of some sources, those in which so many bits have just come since the last packet that was read, or
 * since the first sample.
 */
static int due(const struct rl_detector *detector, int *sources, int count, double bits,
               double from_s, double to_s)
{
    int kept = 0;
    for (int i = 0; i < count; i++) {
        const double begin_s = fmax(detector->free_s[sources[i]], detector->begun_s);
        const double since_s = begin_s + bits * detector->settings.bit_s;
        if (since_s > from_s && since_s <= to_s) {
            sources[kept++] = sources[i];
        }
    }
    return kept;
}

/* How promising a candidate is. */
static float rank(const struct rl_detector *detector, int index)
{
    const struct pending *pending = &detector->pending[index];
    const bool is_sum = detector->samples.source[pending->source].zones > 1;
    return (is_sum ? SUM_SHARE : 1.0f) * pending->hits.hit[0].nats;
}

static void look(struct rl_detector *detector)
{
    const struct rl_samples *samples = &detector->samples;
    const double bit_s = detector->settings.bit_s;
    const double to_s = samples->end_s[samples->count - 1];
    const double from_s = fmax(detector->looked_s, to_s - RL_PACKET_BITS * bit_s);
    const double held_s = to_s - samples->begin_s[samples->count > samples->kept
                                                      ? samples->count - samples->kept
                                                      : 0];
    int sources[RL_MOST_SOURCES];
    detector->pendings = 0;
    detector->search.words_left = WORDS_A_FRAME;
    detector->decisions_left = DECISIONS_A_FRAME;
    detector->looked_s = to_s;
    if (to_s - detector->learnt_s > RL_PACKET_BITS * bit_s) {
        rl_noise_learn(&detector->samples);
        detector->learnt_s = to_s;
    }
    const double packet_bits = RL_PACKET_BITS * (1.0 - MOST_SKEW) - OVERLAP_BITS;
    if (held_s < packet_bits * bit_s) {
        return;
    }
    int count = ready(detector, packet_bits, to_s, true, RL_MOST_ZONES, sources);
    search(detector, sources, count, 0, from_s, to_s);
    const int64_t turn = (int64_t)floor(to_s / (LOOK_BITS * bit_s));
    const bool is_turn = turn != detector->turn;
    detector->turn = turn;
    count = ready(detector, packet_bits, to_s, true, RL_MOST_ZONES, sources);
    if (!is_turn) {
        count = due(detector, sources, count, RL_PACKET_BITS, from_s, to_s);
    }
    search(detector, sources, count, 1, from_s, to_s);
    /* More packets are looked at as soon as there are as many, and then in turn. */
    for (int fold = 1; fold < FOLDS && FOLD[fold] <= detector->settings.max_packets; fold++) {
        const double bits = RL_PACKET_BITS * FOLD[fold] * (1.0 + MOST_SKEW) + 1.0;
        if (held_s < bits * bit_s || bits * bit_s > samples->kept * samples->period_s) {
            break;
        }
        count = ready(detector, bits - OVERLAP_BITS, to_s, false, 1, sources);
        if (!is_turn || turn % (RL_PACKET_BITS / LOOK_BITS + 1) != fold) {
            count = due(detector, sources, count, bits, from_s, to_s);
        }
        search(detector, sources, count, FOLD[fold], from_s, to_s);
    }
    while (detector->pendings > 0 && detector->decisions_left > 0) {
        int best = 0;
        for (int i = 1; i < detector->pendings; i++) {
            if (rank(detector, i) > rank(detector, best)) {
                best = i;
            }
        }
        const struct pending pending = detector->pending[best];
        detector->pending[best] = detector->pending[--detector->pendings];
        judge(detector, &pending, to_s);
    }
    detector->counts.overloads += detector->pendings > 0 || detector->search.words_left == 0;
}

int32_t rl_detector_push(struct rl_detector *detector, int32_t frames, const int64_t *stamp_ns,
                         const float *signal, const float *distance, const float *ambient,
                         const uint8_t *status)
{
    const size_t zones = (size_t)detector->samples.zones;
    const int64_t longest_ns = (int64_t)(RL_PACKET_BITS * detector->settings.bit_s * 1e9);
    detector->readings = detector->candidates = 0;
    for (int32_t frame = 0; frame < frames; frame++) {
        const int64_t stamp = stamp_ns[frame];
        if (detector->samples.count > 0 && stamp == detector->last_ns) {
            continue;
        }
        if (detector->samples.count == 0 || stamp < detector->last_ns ||
            (uint64_t)stamp - (uint64_t)detector->last_ns > (uint64_t)longest_ns) {
            begin_anew(detector, stamp);
        }
        detector->last_ns = stamp;
        const size_t at = (size_t)frame * zones;
        rl_samples_push(&detector->samples, stamp, signal + at, distance + at, ambient + at,
                        status + at);
        look(detector);
        if (detector->candidates > 0) {
            return frame + 1;
        }
    }
    return frames;
}

int32_t rl_detector_readings(const struct rl_detector *detector)
{
    return detector->readings;
}

struct rl_reading rl_detector_reading(const struct rl_detector *detector, int32_t index)
{
    return detector->reading[index];
}

int32_t rl_detector_candidates(const struct rl_detector *detector)
{
    return detector->candidates;
}

struct rl_candidate rl_detector_candidate(const struct rl_detector *detector, int32_t index)
{
    return detector->candidate[index];
}

struct rl_held rl_detector_held(const struct rl_detector *detector)
{
    const struct rl_samples *samples = &detector->samples;
    return (struct rl_held){
        .first = samples->count > samples->kept ? samples->count - samples->kept : 0,
        .count = samples->count,
        .width = samples->width,
        .zones = samples->zones,
        .origin_ns = samples->origin_ns,
        .noise_scale = samples->noise_scale,
        .period_s = samples->period_s,
        .begin_s = samples->begin_s,
        .end_s = samples->end_s,
        .stamp_ns = samples->stamp_ns,
        .signal = samples->signal,
        .valid = samples->valid,
        .distance = samples->distance,
    };
}

void rl_detector_light(const struct rl_detector *detector, const struct rl_reading *reading,
                       int32_t first, int32_t count, double *light)
{
    const struct rl_sending sending = {rl_packet(reading->id), reading->repeats, reading->start_s,
                                       reading->bit_s, reading->brightening_s};
    rl_template(&sending, detector->samples.begin_s + first, detector->samples.end_s + first, count,
                light);
}

void rl_detector_columns(struct rl_detector *detector, int32_t first, int32_t count, float *signal,
                         uint8_t *valid)
{
    struct rl_window *window = &detector->window;
    const int zones = detector->samples.zones;
    for (int zone = 0; zone < zones; zone++) {
        rl_target_column(&detector->samples, zone, first, count, window->signal, window->valid,
                         window->scratch);
        for (int32_t row = 0; row < count; row++) {
            signal[(int64_t)row * zones + zone] = window->signal[row];
            valid[(int64_t)row * zones + zone] = window->valid[row];
        }
    }
}

struct rl_counts rl_detector_counts(const struct rl_detector *detector)
{
    struct rl_counts counts = detector->counts;
    counts.impossible = detector->samples.impossible;
    return counts;
}
