/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_decide.h"

#include "retrolidar_clock.h"
#include "retrolidar_constants.h"
#include "retrolidar_observation.h"
#include "retrolidar_refine.h"
#include "retrolidar_rivals.h"
#include "retrolidar_successive.h"
#include "retrolidar_word.h"

#include <math.h>

enum {
    MIN_WALK = 3, /* walk from which on what a packet leaves over is more than noise */
};

/* Share of the evidence of a packet that has repeated that there must be with the bits before. */
static const double MIN_LONGER = 0.9;
/* Share of the evidence in demand that one channel must have by itself. */
static const double MIN_ALONE = 0.4;
/* Share of what others explain that a packet beside them needs besides: what they leave over may
 * look like one.
 */
static const double LEFT_OVER = 0.1;
/* A refined clock may be off by more than one that is searched: by half a phase over a packet. */
static const double SKEW_SLACK = 0.5 / (RL_PHASES * RL_PACKET_BITS);

/* Whether packets that were taken for some of many may as well be a lone one, which has not ended
 * yet or has ended before.
 */
static bool may_be_lone(struct rl_window *window, const struct rl_transmission *transmission,
                        int packets, double own)
{
    struct rl_transmission lone = *transmission;
    lone.repeats = false;
    for (int packet = 0; packet <= packets; packet++) {
        lone.start_s = transmission->start_s + packet * RL_PACKET_BITS * transmission->bit_s;
        if (rl_window_try(window, &lone) > own - RL_AS_GOOD) {
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
static bool has_repeated(struct rl_window *window, const struct rl_transmission *transmission,
                         double evidence, double begin_s, double since_s, double to_s)
{
    const struct rl_samples *samples = window->samples;
    /* Half a packet shows whether it has repeated. */
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    const double from_s =
        fmax(fmax(begin_s - RL_PACKET_BITS / 2 * transmission->bit_s, held_s), since_s);
    if (begin_s - from_s < RL_LOOK_BITS * transmission->bit_s) {
        return true;
    }
    rl_window_open(window, window->channel, from_s, to_s);
    const double longer = rl_window_try(window, transmission) - window->whitened.null;
    rl_window_open(window, window->channel, begin_s, to_s);
    rl_window_try(window, transmission);
    return longer > MIN_LONGER * evidence - RL_AS_GOOD;
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
    /* A step that comes by chance has a time and a height. */
    const double cost = 2.0 * RL_COST_OF_CHANCE;
    return changes < RL_USUAL_CHANGES ? cost * (RL_USUAL_CHANGES - changes) : 0.0;
}

/* A packet that is judged, and what its window tells. */
struct trial {
    struct rl_window *window;
    const struct rl_demands *demands;
    struct rl_verdict *verdict;
    bool follows;     /* others of this ID and clock */
    bool is_new;      /* whether its marker has just appeared */
    int silent_bits;  /* of the window, before the packet */
    double half_bits; /* from the start to the middle of the window */
    double own;       /* its log likelihood */
    double price;     /* of a gain that changes along it */
    struct rl_bits bits;
};

/* Open the window. Return why the packet cannot be judged, RL_READ if it can. */
static int open(struct trial *trial, int channel, double consumed_until_s, double since_s,
                double to_s)
{
    struct rl_window *window = trial->window;
    const struct rl_demands *demands = trial->demands;
    struct rl_verdict *verdict = trial->verdict;
    struct rl_transmission *transmission = &verdict->transmission;
    const int packets = verdict->packets;
    const double usual_s = window->samples->bit_s;
    window->min_bit_s = usual_s * (1.0 - RL_MAX_SKEW - SKEW_SLACK);
    window->max_bit_s = usual_s * (1.0 + RL_MAX_SKEW + SKEW_SLACK);
    const double bit_s = transmission->bit_s;
    verdict->evidence = rl_observation_open(window, channel, transmission, packets,
                                            consumed_until_s, since_s, to_s, &trial->silent_bits);
    const double lasting_s = RL_PACKET_BITS * packets * transmission->bit_s;
    verdict->begin_s =
        transmission->repeats ? fmax(to_s - lasting_s, since_s) : transmission->start_s;
    verdict->end_s = transmission->repeats ? to_s : transmission->start_s + lasting_s;
    trial->half_bits = rl_observation_half_bits(transmission, packets, to_s);
    trial->own = verdict->evidence + window->whitened.null;
    verdict->fit = window->fit;
    if (verdict->evidence < MIN_ALONE * demands->evidence) {
        return RL_EVIDENCE;
    }
    if ((!transmission->repeats && verdict->end_s > to_s + transmission->bit_s / RL_PHASES) ||
        fabs(transmission->bit_s / usual_s - 1.0) > RL_MAX_SKEW + SKEW_SLACK / 2) {
        /* A packet that has begun looks like a faster one of another ID. */
        return RL_INCOMPLETE;
    }
    /* One that has appeared has not repeated yet. */
    trial->is_new = verdict->begin_s == since_s;
    if (transmission->repeats && packets == 1 && !trial->follows && !trial->is_new &&
        !has_repeated(window, transmission, verdict->evidence, to_s - RL_PACKET_BITS * bit_s,
                      since_s, to_s)) {
        return RL_INCOMPLETE;
    }
    if (rl_observation_is_erased(window, transmission)) {
        return RL_ERASED;
    }
    return transmission->repeats && !trial->is_new &&
                   may_be_lone(window, transmission, packets, trial->own)
               ? RL_INCOMPLETE
               : RL_READ;
}

/* Fit the packet closely; return whether the evidence is enough. */
static bool is_evident(struct trial *trial)
{
    struct rl_window *window = trial->window;
    struct rl_verdict *verdict = trial->verdict;
    trial->own = rl_window_refine(window, &verdict->transmission, trial->half_bits);
    verdict->evidence = trial->own - window->whitened.null;
    verdict->fit = window->fit;
    return verdict->evidence >=
           trial->demands->evidence + cost_of_changes(verdict->transmission.bits) +
               (verdict->packets > 1 ? RL_COST_OF_GAIN : 0.0) +
               (window->fit.walk >= MIN_WALK ? trial->demands->wandering : 0.0) +
               LEFT_OVER * window->whitened.explained;
}

/* Flip the bits of the packet; return how much better another sequence is, if not by far. */
static double flip_bits(struct trial *trial)
{
    const struct rl_transmission *transmission = &trial->verdict->transmission;
    rl_bits_flip(&trial->bits, trial->window, transmission, trial->own, 0, true);
    return rl_word_flip_bits(trial->window, transmission, trial->own, &trial->bits,
                             3.0 * trial->demands->word);
}

/* What a bit of what has appeared costs that is not known. It is judged with each bit again. */
static double price_of_new_bit(void)
{
    return 2.0 * log(2.0);
}

/* Bits that need not be known to tell the IDs in use apart. */
static double spare_bits(const struct rl_codebook *codebook)
{
    return RL_ID_BITS - log2(codebook->words);
}

/* The crystal is slow, so the first of them tells of the one before. */
double rl_decide_min_bits(const struct rl_codebook *codebook, const struct rl_demands *demands)
{
    const double unknown = spare_bits(codebook) + demands->word / price_of_new_bit();
    return fmax(RL_PACKET_BITS - 1 - unknown, RL_LOOK_BITS);
}

/* Of the first bits of the packet, how many the samples do not tell, about: those that may as well
 * be flipped.
 */
static double unknown_bits(const struct rl_bits *bits, int count)
{
    double unknown = 0.0;
    for (int bit = 0; bit < count; bit++) {
        const int at = (bit - bits->first + RL_PACKET_BITS) % RL_PACKET_BITS;
        unknown += exp(fmin((double)bits->flipped[bits->silent + at], 0.0));
    }
    return unknown;
}

/* By how much another sequence may be better. Any sequence looks like a word if enough of its bits
 * are unknown: a bit less of a word's redundancy is a bit more of chance, or two where something has
 * appeared, as that is judged with each bit again. With few registered IDs, more may be unknown, and
 * any of a packet that was expected. None is a packet of which most of the preamble is unknown.
 */
static double max_word_of(const struct trial *trial, const struct rl_codebook *codebook)
{
    const double spare = trial->follows ? RL_PACKET_BITS : spare_bits(codebook);
    const double preamble = unknown_bits(&trial->bits, RL_PREAMBLE_BITS) - spare;
    const double unknown = unknown_bits(&trial->bits, RL_PACKET_BITS) - spare;
    const double price = trial->is_new ? price_of_new_bit() : log(2.0);
    return 2.0 * preamble > RL_PREAMBLE_BITS ? -INFINITY
                                             : trial->demands->word - price * fmax(unknown, 0.0);
}

static bool is_word(struct trial *trial, const struct rl_codebook *codebook,
                    const struct rl_hits *hits, double to_s)
{
    struct rl_verdict *verdict = trial->verdict;
    const struct rl_transmission *transmission = &verdict->transmission;
    const double max_word = trial->demands->word;
    /* A refined start may be later than the begin of the window. */
    const double since_bits = (to_s - transmission->start_s) / transmission->bit_s -
                              RL_PACKET_BITS * (verdict->packets - 1);
    const int since = (int)floor(since_bits + 0.5) % RL_PACKET_BITS;
    const int begin = transmission->repeats ? (since + RL_PACKET_BITS) % RL_PACKET_BITS : 0;
    trial->bits = rl_bits_cut(transmission, begin, trial->silent_bits);
    verdict->word = flip_bits(trial);
    const double any = trial->own + verdict->word;
    trial->price = verdict->packets == 1 && !trial->follows
                       ? rl_window_follow_gain(trial->window, transmission)
                       : 0.0;
    if (trial->price > 0.0) {
        trial->own = rl_window_try(trial->window, transmission);
        verdict->word = fmax(flip_bits(trial), any - (trial->own - trial->price));
    }
    verdict->word = fmax(verdict->word,
                         rl_word_sequence(trial->window, trial->half_bits, hits) - trial->own);
    if (verdict->packets > 1) {
        verdict->word = fmax(verdict->word, rl_word_packets(trial->window, transmission,
                                                            trial->own, 2.0 * max_word));
    }
    return verdict->word <= max_word_of(trial, codebook);
}

/* By how much a packet in a sum of zones must be likelier besides. Markers of several zones blink in
 * it, and together may look like another one: that is a gain more, and the more they leave over, the
 * sooner.
 */
static double price_of_sum(const struct trial *trial)
{
    const struct rl_verdict *verdict = trial->verdict;
    const bool is_sum = trial->window->samples->channel[verdict->channel].zones > 1;
    const double excess = rl_excess_variance(&trial->window->whitened, &verdict->fit);
    return is_sum && !trial->follows ? RL_COST_OF_GAIN + log(excess) : 0.0;
}

/* How much likelier the packet is than what else may have been sent. */
static double margin_of(struct trial *trial, const struct rl_codebook *codebook,
                        const struct rl_hits *hits)
{
    struct rl_window *window = trial->window;
    const struct rl_verdict *verdict = trial->verdict;
    const struct rl_transmission *transmission = &verdict->transmission;
    const uint16_t id = verdict->id;
    double margin = rl_rivals_margin(window, codebook, &trial->bits, transmission, verdict->packets,
                                     trial->own, trial->half_bits, id, hits);
    /* A marker whose packets are known goes on sending them more likely than it does this. */
    if (margin >= trial->demands->margin && verdict->packets == 1 && !trial->follows) {
        margin = fmin(margin, rl_rivals_part_margin(window, codebook, &trial->bits, transmission,
                                                    trial->own, id));
        margin = fmin(margin, rl_successive_margin(window, codebook, &trial->bits, transmission,
                                                   trial->own, id));
    }
    return margin - trial->price;
}

struct rl_verdict rl_decide(struct rl_window *window, const struct rl_codebook *codebook,
                            const struct rl_demands *demands, int channel, const struct rl_hit *hit,
                            const struct rl_hits *hits, int packets, double consumed_until_s,
                            double since_s, bool follows, double to_s)
{
    struct rl_verdict verdict = {.id = hit->id,
                                 .channel = channel,
                                 .packets = packets,
                                 .transmission = hit->transmission};
    struct trial trial = {
        .window = window, .demands = demands, .verdict = &verdict, .follows = follows};
    verdict.reason = open(&trial, channel, consumed_until_s, since_s, to_s);
    if (verdict.reason != RL_READ) {
        return verdict;
    }
    verdict.reason = RL_EVIDENCE;
    if (!is_evident(&trial)) {
        return verdict;
    }
    verdict.reason = RL_NOT_A_WORD;
    if (!is_word(&trial, codebook, hits, to_s)) {
        return verdict;
    }
    verdict.reason = RL_MARGIN;
    verdict.margin = margin_of(&trial, codebook, hits);
    if (verdict.margin < demands->margin + price_of_sum(&trial)) {
        return verdict;
    }
    rl_window_steady(window);
    const double steady = trial.own - trial.price;
    const double other = packets == 1 ? rl_clock_excess(window, &verdict.transmission, steady)
                                      : rl_clock_period_excess(window, &verdict.transmission);
    verdict.word = fmax(verdict.word, other);
    verdict.reason = other > demands->word ? RL_NOT_A_WORD : RL_READ;
    return verdict;
}
