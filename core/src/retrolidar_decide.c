/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_decide.h"

#include <math.h>

/* A packet that has repeated keeps this share of its evidence if the bits before are added. */
static const double MIN_LONGER = 0.9;
/* A candidate with less than this share of the threshold is rejected at once. */
static const double MIN_ALONE = 0.4;
/* A refined clock may be off by this more than a searched one: half a phase over a packet. */
static const double SKEW_SLACK = 0.5 / (RL_PHASES * RL_PACKET_BITS);

/* Whether a lone packet, ended or not, explains the window as well as one that repeats. */
static bool may_be_lone(const struct rl_case *judged)
{
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    struct rl_transmission lone = *transmission;
    lone.repeats = false;
    for (int packet = 0; packet <= judged->verdict.packets; packet++) {
        lone.start_s = transmission->start_s + packet * RL_PACKET_BITS * transmission->bit_s;
        if (rl_window_try(judged->window, &lone) > judged->log_likelihood - RL_AS_GOOD) {
            return true;
        }
    }
    return false;
}

/* Whether the samples before a stretch, too, speak for a packet that repeats. A lone packet that
 * has not ended yet may look like another one that repeats.
 *
 * begin_s: of the stretch; the window is opened again there, as likelihoods of other samples cannot
 *     be compared
 */
static bool has_repeated(const struct rl_case *judged, double begin_s)
{
    struct rl_window *window = judged->window;
    const struct rl_verdict *verdict = &judged->verdict;
    const struct rl_samples *samples = window->samples;
    const double bit_s = verdict->transmission.bit_s;
    /* Half a packet shows whether it has repeated. */
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    const double from_s =
        fmax(fmax(begin_s - RL_PACKET_BITS / 2 * bit_s, held_s), judged->since_s);
    if (begin_s - from_s < RL_LOOK_BITS * bit_s) {
        return true;
    }
    rl_window_open(window, verdict->channel, verdict->is_dimmer, from_s, judged->to_s);
    const double longer = rl_window_try(window, &verdict->transmission) - rl_window_null(window);
    rl_window_open(window, verdict->channel, verdict->is_dimmer, begin_s, judged->to_s);
    return longer > MIN_LONGER * verdict->evidence - RL_AS_GOOD;
}

/* Additional evidence for a packet of few changes, as an object that moves may look like it. */
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

/* Open the window. Return why the packet cannot be judged, RL_READ if it can. */
static int open(struct rl_case *judged)
{
    struct rl_window *window = judged->window;
    const struct rl_verdict *verdict = &judged->verdict;
    const struct rl_transmission *transmission = &verdict->transmission;
    const double usual_s = window->samples->bit_s;
    window->min_bit_s = usual_s * (1.0 - RL_MAX_SKEW - SKEW_SLACK);
    window->max_bit_s = usual_s * (1.0 + RL_MAX_SKEW + SKEW_SLACK);
    const double begin_s = judged->to_s - RL_PACKET_BITS * transmission->bit_s;
    rl_observation_open(judged);
    if (verdict->evidence < MIN_ALONE * judged->thresholds->evidence) {
        return RL_EVIDENCE;
    }
    if ((!transmission->repeats &&
         verdict->end_s > judged->to_s + transmission->bit_s / RL_PHASES) ||
        fabs(transmission->bit_s / usual_s - 1.0) > RL_MAX_SKEW + SKEW_SLACK / 2) {
        /* A packet that has begun looks like a faster one of another ID. */
        return RL_INCOMPLETE;
    }
    /* One that has appeared has not repeated yet. */
    judged->is_new = verdict->begin_s == judged->since_s;
    if (transmission->repeats && verdict->packets == 1 && !judged->follows && !judged->is_new &&
        !has_repeated(judged, begin_s)) {
        return RL_INCOMPLETE;
    }
    if (rl_observation_is_erased(judged)) {
        return RL_ERASED;
    }
    return transmission->repeats && !judged->is_new && may_be_lone(judged) ? RL_INCOMPLETE
                                                                           : RL_READ;
}

/* What an expected packet need not explain: a start among all that are searched. */
static double saved_start(const struct rl_case *judged)
{
    return judged->is_expected ? RL_COST_OF_CHANCE : 0.0;
}

/* Fit the packet closely; return whether the evidence is enough. */
static bool is_evident(struct rl_case *judged)
{
    struct rl_window *window = judged->window;
    struct rl_verdict *verdict = &judged->verdict;
    rl_window_refine(window, &verdict->transmission, judged->half_bits);
    judged->price =
        verdict->packets == 1 ? rl_window_follow_gain(window, &verdict->transmission) : 0.0;
    judged->log_likelihood = rl_window_try(window, &verdict->transmission);
    verdict->evidence = judged->log_likelihood - judged->price - rl_window_null(window);
    return verdict->evidence >=
           judged->thresholds->evidence - saved_start(judged) +
               cost_of_changes(verdict->transmission.bits) +
               (verdict->packets > 1 ? RL_COST_OF_GAIN : 0.0) +
               (window->fit.walk >= RL_WANDERS ? judged->thresholds->wandering : 0.0);
}

/* Price of an unknown bit if the marker has just appeared, as it is judged with each bit again. */
static double price_of_new_bit(void)
{
    return 2.0 * log(2.0);
}

/* Bits of an ID that are not needed to tell the registered ones apart. */
static double spare_bits(const struct rl_codebook *codebook)
{
    return RL_ID_BITS - log2(codebook->words);
}

/* The crystal is slow, so the first of them tells of the one before. */
double rl_decide_min_bits(const struct rl_codebook *codebook,
                          const struct rl_thresholds *thresholds)
{
    const double unknown = spare_bits(codebook) + thresholds->word / price_of_new_bit();
    return fmax(RL_PACKET_BITS - 1 - unknown, RL_LOOK_BITS);
}

/* About how many of the first bits are unknown: flipped, they explain as much. */
static double unknown_bits(const struct rl_bits *bits, int count)
{
    double unknown = 0.0;
    for (int bit = 0; bit < count; bit++) {
        const float flipped = bits->flipped[bits->silent + rl_bit_of(bit - bits->first)];
        unknown += exp(fmin((double)flipped, 0.0));
    }
    return unknown;
}

/* Whether several markers may be seen: what they leave, or send together, may look like one packet.
 */
static bool is_among_others(const struct rl_case *judged)
{
    const struct rl_window *window = judged->window;
    return window->whitened.interferers > 0 ||
           window->samples->channel[judged->verdict.channel].zones > 1;
}

/* The price of a start among others, for the margin; the word test asks half of it. */
static double price_of_start(const struct rl_case *judged)
{
    return is_among_others(judged) && !judged->is_expected ? RL_COST_OF_CHANCE : 0.0;
}

/* The threshold of the word statistic if all bits are known. The statistic of the packet before
 * counts, too: bits that explain both packets a little better are what is sent.
 */
static double max_word_of(const struct rl_case *judged)
{
    return judged->thresholds->word + saved_start(judged) - 0.5 * price_of_start(judged) -
           judged->word_before;
}

/* What unknown bits take from the threshold. If enough bits are unknown, any sequence looks like a
 * word, so each lowers the threshold; by twice as much if the marker has just appeared, as it is
 * judged with each bit again. With few registered IDs, or if the packet was expected, more bits may
 * be unknown. Half of the preamble must be known.
 */
static double price_of_unknown_bits(const struct rl_case *judged)
{
    const double spare = judged->follows ? RL_PACKET_BITS : spare_bits(judged->codebook);
    const double preamble = unknown_bits(&judged->bits, RL_PREAMBLE_BITS) - spare;
    const double unknown = unknown_bits(&judged->bits, RL_PACKET_BITS) - spare;
    const double price = judged->is_new ? price_of_new_bit() : log(2.0);
    return 2.0 * preamble > RL_PREAMBLE_BITS ? INFINITY : price * fmax(unknown, 0.0);
}

static bool is_word(struct rl_case *judged)
{
    struct rl_verdict *verdict = &judged->verdict;
    const struct rl_transmission *transmission = &verdict->transmission;
    const double since_bits = (judged->to_s - transmission->start_s) / transmission->bit_s;
    const int begin = transmission->repeats ? rl_bit_of((int)floor(since_bits + 0.5)) : 0;
    double max_word = max_word_of(judged);
    judged->bits = rl_bits_cut(transmission, begin, judged->silent_bits);
    verdict->word = rl_word_flip_bits(judged, max_word);
    if (verdict->word > max_word) {
        return false; /* and not all flipped bits have been tried */
    }
    max_word -= price_of_unknown_bits(judged);
    verdict->word = fmax(verdict->word, rl_word_sequence(judged, max_word));
    return verdict->word <= max_word;
}

/* The decision margin, less its price among others: there, other bits that explain more may be
 * those of another ID, disturbed.
 */
static double margin_of(struct rl_case *judged)
{
    const double other_bits = is_among_others(judged) ? fmax(judged->verdict.word, 0.0) : 0.0;
    const double price = price_of_start(judged) + other_bits;
    double margin = rl_rivals_margin(judged) - price;
    /* A known marker more likely continues than does this. */
    if (margin >= judged->thresholds->margin && judged->verdict.packets == 1 && !judged->follows) {
        margin = fmin(margin, rl_rivals_part_margin(judged) - price);
        margin = fmin(margin, rl_rivals_successive_margin(judged) + saved_start(judged) - price);
    }
    return margin;
}

struct rl_verdict rl_decide(struct rl_case *judged)
{
    struct rl_verdict *verdict = &judged->verdict;
    verdict->reason = open(judged);
    if (verdict->reason != RL_READ) {
        return *verdict;
    }
    verdict->reason = RL_EVIDENCE;
    if (!is_evident(judged)) {
        return *verdict;
    }
    verdict->reason = RL_NOT_A_WORD;
    if (!is_word(judged)) {
        return *verdict;
    }
    verdict->reason = RL_MARGIN;
    verdict->margin = margin_of(judged);
    if (verdict->margin < judged->thresholds->margin) {
        return *verdict;
    }
    rl_window_keep_gain(judged->window);
    const double steady = judged->log_likelihood - judged->price;
    const double other =
        verdict->packets == 1 ? rl_clock_excess(judged->window, &verdict->transmission, steady)
                              : rl_clock_period_excess(judged->window, &verdict->transmission);
    verdict->word = fmax(verdict->word, other);
    verdict->reason = other > judged->thresholds->word ? RL_NOT_A_WORD : RL_READ;
    return *verdict;
}
