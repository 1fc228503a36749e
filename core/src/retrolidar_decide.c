/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_decide.h"

#include "retrolidar_packet.h"

#include <math.h>
#include <string.h>

enum {
    SILENT_BITS = 31, /* before a lone packet, which tell its bright level */
    BEFORE_BITS = 16, /* before a stretch, which tell whether its packet has repeated */
    MOST_BITS = SILENT_BITS + RL_PACKET_BITS, /* that a window is cut into */
    MOST_ERASED_BITS = 7, /* so many leave words of a code of distance 8 apart */
    MOST_HIDDEN_BITS = 3, /* half a bit at either end is left out, too */
    RIVALS = 3,           /* that are tried exactly */
    WANDERING = 3, /* walk from which on what a packet leaves over is more than noise */
    USUAL_CHANGES = 12, /* that all words but those of IDs 1 and 4094 have */
    ROUNDS = 4,           /* bits that are turned to make a better sequence */
};

/* Share of the samples of a window that must be valid. */
static const double LEAST_VALID = 0.5;
/* Bits before a stretch that tell whether its packet has repeated, and share of its evidence that
 * there must be with them.
 */
static const double LEAST_BEFORE_BITS = 4.0, LEAST_LONGER = 0.9;
/* Share of the evidence in demand that one source must have by itself. */
static const double LEAST_ALONE = 0.4;
/* Another zone counts if it adds so much to the evidence, and the packet explains such a share of how
 * it varies beyond noise, or it sees something else. It has a gain of its own, which costs some.
 */
static const double LEAST_ADDED = 4.0, LEAST_SHARE = 0.5, COST_OF_GAIN = 2.0;
/* A bit is wrong if the other one is better by so much; to leave out a stretch of such costs some, as
 * it might be any.
 */
static const double LEAST_TURNED = 2.0, COST_OF_BURST = 5.0;
/* [nats] a change that a word has less. */
static const double COST_OF_CHANGE = 5.0;
/* Several packets are tried at several numbers of them, and at more clocks [nats]. */
static const double COST_OF_FOLDS = 1.5;
/* Part of the last bit that need not have come yet. */
static const double NOT_YET_BITS = 0.25;
/* By how much a part of a lone packet may be worse than a whole one to be as good [nats]. */
static const double AS_GOOD = 1.0;
/* A refined clock may be off by so much more than one that is searched. */
static const double SKEW_SLACK = 0.005;
/* Nobody asks for more, so it need not be known exactly [nats]. */
static const double ENOUGH = 30.0;

/* A window cut into the bits of the packet in question, in the order of time. */
struct bits {
    int count;   /* 31, or the silence before, too */
    double begin_s; /* of the first [s] */
    bool repeats;
    float turned[MOST_BITS]; /* log likelihood if a bit were the other one, less that as it is */
    bool dark[MOST_BITS];
};

struct rival {
    float nats; /* about, less those of the packet in question */
    struct rl_sending sending;
    uint16_t id;
};

static struct rl_sending with_bits(const struct rl_sending *sending, uint32_t bits)
{
    struct rl_sending other = *sending;
    other.bits = bits;
    return other;
}

static int least_rows(const struct rl_window *window)
{
    return (int)(LEAST_VALID * window->rows);
}

static double refine(struct rl_window *window, const struct rl_demands *demands,
                     struct rl_sending *sending, double half_bits)
{
    return rl_window_refine(window, sending, half_bits,
                            demands->bit_s * (1.0 - demands->most_skew - SKEW_SLACK),
                            demands->bit_s * (1.0 + demands->most_skew + SKEW_SLACK));
}

/* Log likelihood of the best sequence of bits that the search has found, of a packet or not. */
static double any_sequence(struct rl_window *window, const struct rl_demands *demands,
                           const struct rl_sending *sending, double half_bits,
                           const struct rl_hits *hits)
{
    double best = -INFINITY;
    for (int i = 0; i < hits->sequences; i++) {
        const struct rl_sequence *sequence = &hits->sequence[i];
        struct rl_sending any = *sending;
        any.bits = sequence->bits;
        any.repeats = sequence->repeats;
        any.start_s = sequence->start_s;
        any.bit_s = sequence->bit_s;
        best = fmax(best, refine(window, demands, &any, half_bits));
    }
    return best;
}

/* Open the window that a hit was found in; for a lone packet that with the silence before it, if it
 * is the better one.
 */
static double open_window(struct rl_window *window, int source, struct rl_sending *sending,
                          int packets, double free_s, double to_s, const struct rl_demands *demands,
                          double *silent_bits)
{
    const double window_bits = RL_PACKET_BITS * packets;
    *silent_bits = 0.0;
    if (sending->repeats) {
        const double from_s = to_s - window_bits * sending->bit_s;
        rl_window_open(window, source, from_s, to_s);
        return refine(window, demands, sending,
                      (to_s - sending->start_s) / sending->bit_s - window_bits / 2) - window->null;
    }
    const double end_s = sending->start_s + RL_PACKET_BITS * sending->bit_s;
    rl_window_open(window, source, sending->start_s, end_s);
    const double tight = refine(window, demands, sending, RL_PACKET_BITS / 2.0) -
                         window->null;
    const double silence_s = fmin(SILENT_BITS * sending->bit_s, sending->start_s - free_s);
    if (silence_s < sending->bit_s) {
        return tight;
    }
    struct rl_sending lone = *sending;
    rl_window_open(window, source, lone.start_s - silence_s, lone.start_s + RL_PACKET_BITS * lone.bit_s);
    const double wide = refine(window, demands, &lone, RL_PACKET_BITS / 2.0) -
                        window->null;
    if (wide > tight) {
        *sending = lone;
        *silent_bits = floor(silence_s / lone.bit_s);
        return wide;
    }
    rl_window_open(window, source, sending->start_s, sending->start_s + RL_PACKET_BITS * sending->bit_s);
    return refine(window, demands, sending, RL_PACKET_BITS / 2.0) - window->null;
}

/* Whether most of how a source varies beyond noise is the template that was tried last. */
static bool is_seen(const struct rl_window *window, int index)
{
    const struct rl_whitened *whitened = &window->whitened[index];
    double sum = 0.0, square = 0.0;
    for (int row = 0; row < window->rows; row++) {
        sum += window->light[row];
        square += window->light[row] * window->light[row];
    }
    const double gain = window->fit[index].gain;
    const double explained = gain * gain * (square - sum * sum / window->rows) / window->rows;
    const double noise = 2.0 * whitened->least;
    return explained > LEAST_SHARE * (whitened->squares[0] / (whitened->samples - 1) - noise);
}

/* Add zones near by that see the same packet; return the evidence of all. */
static double add_zones(struct rl_window *window, const struct rl_sending *sending, double evidence)
{
    const struct rl_samples *samples = window->samples;
    const struct rl_source *of = &samples->source[window->source[0]];
    if (of->zones > 1) {
        return evidence;
    }
    const int row = of->zone[0] / samples->columns_of_zones;
    const int column = of->zone[0] % samples->columns_of_zones;
    for (int down = -1; down <= 1; down++) {
        for (int right = -1; right <= 1; right++) {
            const int r = row + down, c = column + right;
            const int before = window->sources;
            if (r < 0 || c < 0 || r >= samples->rows_of_zones || c >= samples->columns_of_zones) {
                continue;
            }
            rl_window_add(window, r * samples->columns_of_zones + c);
            if (window->sources == before) {
                continue;
            }
            const double together = rl_window_try(window, sending) - window->null;
            if (window->whitened[before].samples < least_rows(window) ||
                together - evidence < LEAST_ADDED || !is_seen(window, before)) {
                rl_window_drop(window);
            } else {
                evidence = together;
            }
        }
    }
    return evidence;
}

static bool too_much_erased(const struct rl_window *window, const struct rl_sending *sending)
{
    const struct rl_whitened *whitened = &window->whitened[0];
    double known[RL_PACKET_BITS] = {0.0}, all[RL_PACKET_BITS] = {0.0};
    const struct rl_samples *samples = window->samples;
    int sample = 0, erased = 0;
    if (whitened->samples < least_rows(window)) {
        return true;
    }
    for (int row = 0; row < window->rows; row++) {
        const bool valid = sample < whitened->samples && whitened->row[sample] == row;
        sample += valid;
        const double middle_s =
            (samples->begin_s[window->first + row] + samples->end_s[window->first + row]) / 2;
        const double since = floor((middle_s - sending->start_s) / sending->bit_s);
        if (!sending->repeats && (since < 0.0 || since >= RL_PACKET_BITS)) {
            continue;
        }
        const int bit = (int)(since - RL_PACKET_BITS * floor(since / RL_PACKET_BITS));
        all[bit] += 1.0;
        known[bit] += valid;
    }
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        erased += known[bit] < 0.25 * all[bit] || all[bit] == 0.0;
    }
    return erased > MOST_ERASED_BITS;
}

/* Cut the window into bits and turn each; return how much better another sequence of the packet's
 * own bits may be.
 *
 * begin: which bit of the packet the window begins with, after so many silent bits
 */
static double turn_bits(struct rl_window *window, const struct rl_sending *sending, double own,
                        int begin, int silent_bits, double enough, struct bits *bits)
{
    double better = 0.0;
    float first[RL_PACKET_BITS]; /* of each bit of the packet */
    uint32_t sequence = sending->bits;
    bits->count = silent_bits + RL_PACKET_BITS;
    bits->begin_s = sending->start_s + (begin - silent_bits) * sending->bit_s;
    bits->repeats = sending->repeats;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        const uint32_t turned = rl_packet_bit((begin + bit) % RL_PACKET_BITS);
        const struct rl_sending other = with_bits(sending, sequence ^ turned);
        bits->dark[silent_bits + bit] = (sequence & turned) != 0;
        bits->turned[silent_bits + bit] = (float)(rl_window_try(window, &other) - own);
        first[(begin + bit) % RL_PACKET_BITS] = bits->turned[silent_bits + bit];
    }
    for (int bit = 0; bit < silent_bits; bit++) {
        /* What a dark bit there would do is not tried: about as much as in the packet. */
        bits->dark[bit] = false;
        bits->turned[bit] = first[1];
    }
    for (int round = 0; round < ROUNDS && better < enough; round++) {
        int best = -1;
        double most = better;
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            if (round == 0 || first[bit] > -ENOUGH) {
                const struct rl_sending other = with_bits(sending, sequence ^ rl_packet_bit(bit));
                const double gained =
                    round == 0 ? (double)first[bit] : rl_window_try(window, &other) - own;
                if (gained > most) {
                    most = gained;
                    best = bit;
                }
            }
        }
        if (best < 0) {
            break;
        }
        sequence ^= rl_packet_bit(best);
        better = most;
    }
    return better;
}

/* Leave out the stretch of a few bits which would be likeliest if all of it were dark: something has
 * hidden the marker for a while. Return whether there is one.
 */
static bool hide_burst(struct rl_window *window, const struct rl_sending *sending, double own)
{
    double most = own + LEAST_TURNED;
    int first = -1, last = -1;
    for (int length = 1; length <= MOST_HIDDEN_BITS; length++) {
        for (int begin = 0; begin + length <= RL_PACKET_BITS; begin++) {
            uint32_t dark = sending->bits;
            for (int bit = begin; bit < begin + length; bit++) {
                dark |= rl_packet_bit(bit);
            }
            if (dark != sending->bits) {
                const struct rl_sending other = with_bits(sending, dark);
                const double likelihood = rl_window_try(window, &other);
                if (likelihood > most) {
                    most = likelihood;
                    first = begin;
                    last = begin + length - 1;
                }
            }
        }
    }
    if (first < 0) {
        return false;
    }
    /* Of a packet that repeats, the window holds the bits of the one that began before or in it. */
    const double begin_s = (window->samples->begin_s[window->first]);
    double from_s = sending->start_s + (first - 0.5) * sending->bit_s;
    if (sending->repeats && from_s + (last - first + 2) * sending->bit_s < begin_s) {
        from_s += RL_PACKET_BITS * sending->bit_s;
    }
    rl_window_hide(window, from_s, from_s + (last - first + 2) * sending->bit_s);
    return true;
}

static void keep_rival(struct rival *rivals, const struct rival *rival)
{
    struct rival kept = *rival;
    for (int i = 0; i < RIVALS; i++) {
        if (kept.nats > rivals[i].nats) {
            const struct rival worse = rivals[i];
            rivals[i] = kept;
            kept = worse;
        }
    }
}

/* Find the packet, not of the ID in question, that is likeliest if it begins at a bit of the window,
 * by the sum over the bits that it turns.
 */
static void find_rival(const struct rl_codebook *codebook, const struct bits *bits,
                       const struct rl_sending *sending, uint16_t id, int begin, bool repeats,
                       struct rival *rivals)
{
    float weight[RL_PACKET_BITS], all = 0.0f, most;
    memset(weight, 0, sizeof weight);
    for (int bit = 0; bit < bits->count; bit++) {
        /* All bright first; then what a dark bit adds. */
        all += bits->dark[bit] ? bits->turned[bit] : 0.0f;
        const int of = repeats ? ((bit - begin) % RL_PACKET_BITS + RL_PACKET_BITS) % RL_PACKET_BITS : bit - begin;
        if (of >= 0 && of < RL_PACKET_BITS) {
            weight[of] += bits->dark[bit] ? -bits->turned[bit] : bits->turned[bit];
        }
    }
    most = all + weight[0] + weight[2] + weight[4] + weight[6];
    for (int bit = RL_PACKET_BITS - RL_WORD_BITS; bit < RL_PACKET_BITS; bit++) {
        most += fmaxf(weight[bit], 0.0f);
    }
    if (most < -(float)ENOUGH || most <= rivals[RIVALS - 1].nats) {
        return;
    }
    const int word = rl_codebook_heaviest(codebook, weight, id);
    if (word < 0) {
        return;
    }
    float nats = all;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        nats += codebook->packet[word] & rl_packet_bit(bit) ? weight[bit] : 0.0f;
    }
    struct rival rival = {nats, with_bits(sending, codebook->packet[word]), codebook->id[word]};
    rival.sending.repeats = repeats;
    rival.sending.start_s = bits->begin_s + begin * sending->bit_s;
    keep_rival(rivals, &rival);
}

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
static double margin_of(struct rl_window *window, const struct rl_codebook *codebook,
                        const struct rl_demands *demands, const struct bits *bits,
                        const struct rl_sending *sending, int packets, double own, double half_bits,
                        uint16_t id, const struct rl_hits *hits)
{
    struct rival rivals[RIVALS];
    for (int i = 0; i < RIVALS; i++) {
        rivals[i].nats = -INFINITY;
    }
    for (int begin = 1 - RL_PACKET_BITS; begin < bits->count; begin++) {
        if (packets == 1) {
            find_rival(codebook, bits, sending, id, begin, false, rivals);
        }
        if (bits->repeats && begin >= 0) {
            find_rival(codebook, bits, sending, id, begin, true, rivals);
        }
    }
    double nearest = own - ENOUGH;
    for (int i = 0; i < RIVALS + hits->count; i++) {
        struct rl_sending other;
        if (i < RIVALS) {
            if (!(rivals[i].nats > -ENOUGH)) {
                continue;
            }
            other = rivals[i].sending;
        } else {
            const struct rl_hit *hit = &hits->hit[i - RIVALS];
            if (hit->id == id) {
                continue;
            }
            other = *sending;
            other.bits = rl_packet(hit->id);
            other.repeats = hit->repeats;
            other.start_s = hit->start_s;
            other.bit_s = hit->bit_s;
        }
        double likelihood = rl_window_try(window, &other);
        if (likelihood > nearest - ENOUGH / 2) {
            likelihood = refine(window, demands, &other, half_bits);
        }
        nearest = fmax(nearest, likelihood);
    }
    return own - nearest;
}

/* Whether packets that were taken for some of many may as well be a lone one, which has not ended yet
 * or has ended before.
 */
static bool may_be_lone(struct rl_window *window, const struct rl_sending *sending, int packets,
                        double own)
{
    struct rl_sending lone = *sending;
    lone.repeats = false;
    for (int packet = 0; packet <= packets; packet++) {
        lone.start_s = sending->start_s + packet * RL_PACKET_BITS * sending->bit_s;
        if (rl_window_try(window, &lone) > own - AS_GOOD) {
            return true;
        }
    }
    return false;
}

/* Whether the samples before a stretch speak for a packet that repeats, as those in it do. A lone
 * packet whose end has not come yet may look like another one that repeats.
 *
 * begin_s: of the stretch, as the window was opened; it is opened so again, as likelihoods of other
 *     samples cannot be compared
 */
static bool has_repeated(struct rl_window *window, const struct rl_sending *sending, double evidence,
                         double begin_s, double since_s, double to_s)
{
    const struct rl_samples *samples = window->samples;
    const int held = samples->count > samples->kept ? samples->count - samples->kept : 0;
    const double from_s =
        fmax(fmax(begin_s - BEFORE_BITS * sending->bit_s, samples->begin_s[held]), since_s);
    if (begin_s - from_s < LEAST_BEFORE_BITS * sending->bit_s) {
        return true;
    }
    rl_window_open(window, window->source[0], from_s, to_s);
    const double longer = rl_window_try(window, sending) - window->null;
    rl_window_open(window, window->source[0], begin_s, to_s);
    rl_window_try(window, sending);
    return longer > LEAST_LONGER * evidence - AS_GOOD;
}

/* What speaks against a packet in one source by itself: RL_REASONS if nothing does. */
static int doubt(struct rl_window *window, const struct rl_demands *demands,
                 const struct rl_sending *sending, int packets, double own, double half_bits,
                 const struct rl_hits *hits, double *word)
{
    if (sending->repeats && may_be_lone(window, sending, packets, own)) {
        return RL_INCOMPLETE;
    }
    *word = any_sequence(window, demands, sending, half_bits, hits) - own;
    return *word > demands->word ? RL_NOT_A_WORD : RL_REASONS;
}

/* Evidence that a packet of few changes needs besides: the fewer, the sooner do steps of what moves
 * make one.
 */
static double cost_of_changes(uint32_t bits)
{
    int changes = 0;
    for (int bit = 0; bit + 1 < RL_PACKET_BITS; bit++) {
        changes += ((bits >> bit ^ bits >> (bit + 1)) & 1u) != 0;
    }
    return changes < USUAL_CHANGES ? COST_OF_CHANGE * (USUAL_CHANGES - changes) : 0.0;
}

static void note_fit(struct rl_verdict *verdict, const struct rl_window *window)
{
    verdict->sources = window->sources;
    memcpy(verdict->source, window->source, sizeof verdict->source);
    memcpy(verdict->fit, window->fit, sizeof verdict->fit);
}

struct rl_verdict rl_decide(struct rl_window *window, const struct rl_codebook *codebook,
                            const struct rl_demands *demands, int source, const struct rl_hit *hit,
                            const struct rl_hits *hits, int packets, double free_s, double since_s,
                            double to_s)
{
    struct rl_verdict verdict = {.reason = RL_EVIDENCE, .id = hit->id, .packets = packets};
    struct rl_sending *sending = &verdict.sending;
    struct bits bits;
    double silent_bits;
    *sending = (struct rl_sending){rl_packet(hit->id), hit->repeats, hit->start_s, hit->bit_s, 0.0035};
    verdict.evidence =
        open_window(window, source, sending, packets, free_s, to_s, demands, &silent_bits);
    verdict.end_s = sending->repeats ? to_s : sending->start_s + RL_PACKET_BITS * sending->bit_s;
    note_fit(&verdict, window);
    if (verdict.evidence < LEAST_ALONE * demands->evidence) {
        return verdict;
    }
    verdict.reason = RL_INCOMPLETE;
    double own = verdict.evidence + window->null;
    if ((!sending->repeats && verdict.end_s > to_s + NOT_YET_BITS * sending->bit_s) ||
        fabs(sending->bit_s / demands->bit_s - 1.0) > demands->most_skew + SKEW_SLACK / 2) {
        /* A packet that has begun looks like a faster one of another ID. */
        return verdict;
    }
    if (sending->repeats && packets == 1 &&
        !has_repeated(window, sending, verdict.evidence, to_s - RL_PACKET_BITS * hit->bit_s, since_s,
                      to_s)) {
        return verdict;
    }
    verdict.reason = RL_ERASED;
    if (too_much_erased(window, sending)) {
        return verdict;
    }
    const double half_bits =
        sending->repeats ? (to_s - sending->start_s) / sending->bit_s - RL_PACKET_BITS * packets / 2.0
                         : RL_PACKET_BITS / 2.0;
    const double since_bits =
        (to_s - RL_PACKET_BITS * packets * sending->bit_s - sending->start_s) / sending->bit_s;
    const int begin = sending->repeats ? (int)floor(since_bits + 0.5) % RL_PACKET_BITS : 0;
    double asked = demands->evidence + cost_of_changes(sending->bits) +
                   (packets > 1 ? COST_OF_FOLDS : 0.0);
    /* Before others are asked: two zones may see different packets of which this one is a bit. */
    verdict.reason = doubt(window, demands, sending, packets, own, half_bits, hits, &verdict.word);
    if (verdict.reason == RL_NOT_A_WORD && packets == 1 && verdict.evidence > asked) {
        if (hide_burst(window, sending, own)) {
            own = refine(window, demands, sending, half_bits);
            verdict.evidence = own - window->null;
            asked += COST_OF_BURST;
            verdict.reason =
                doubt(window, demands, sending, packets, own, half_bits, hits, &verdict.word);
        }
    }
    if (verdict.reason != RL_REASONS) {
        return verdict;
    }
    verdict.reason = RL_EVIDENCE;
    verdict.evidence = add_zones(window, sending, verdict.evidence);
    verdict.evidence -= COST_OF_GAIN * (window->sources - 1);
    own = refine(window, demands, sending, half_bits);
    note_fit(&verdict, window);
    asked += window->fit[0].walk >= WANDERING ? demands->wandering : 0.0;
    if (verdict.evidence < asked) {
        return verdict;
    }
    verdict.reason = RL_NOT_A_WORD;
    verdict.word =
        turn_bits(window, sending, own, begin, (int)silent_bits, 3.0 * demands->word, &bits);
    if (verdict.word > demands->word) {
        return verdict;
    }
    verdict.reason = RL_MARGIN;
    verdict.margin = margin_of(window, codebook, demands, &bits, sending, packets, own, half_bits,
                               hit->id, hits);
    if (verdict.margin >= demands->margin) {
        verdict.reason = RL_REASONS;
    }
    return verdict;
}
