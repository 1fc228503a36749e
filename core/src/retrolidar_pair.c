/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Two packets in a zone that begin together. Other packets may have the same sum, bit by bit; only
 * different gains tell such pairs apart.
 */
#include "retrolidar_detector_state.h"

#include <math.h>

enum { MAX_OTHERS = 32 }; /* pairs of the same sum; more cannot be told apart */
/* Packets begin together if their starts differ by less [bits]. */
static const double TOGETHER_BITS = RL_LOOK_BITS / 2.0;

/* A pair of the same sum, and its approximate log likelihood. */
struct other_pair {
    float likelihood;
    uint32_t flipped; /* bits of both that differ from the pair that is judged */
};

/* Open the window of a packet, with another one beside it, and what was read of other markers. */
static void open_beside(struct rl_detector *detector, const struct rl_verdict *one,
                        const struct rl_verdict *other)
{
    struct rl_window *window = &detector->window;
    rl_pool_interference(&detector->pool, detector->samples.channel[one->channel].mask,
                         one->begin_s, one->id, other->id, &window->interference);
    rl_window_open(window, one->channel, one->is_dimmer, one->begin_s, one->end_s);
    rl_window_add(window, &other->transmission);
}

/* Refine a packet in its zone, with another one beside it; return their log likelihood. */
static double refine_beside(struct rl_detector *detector, struct rl_verdict *one,
                            const struct rl_verdict *other)
{
    struct rl_transmission *transmission = &one->transmission;
    const double middle_s = (one->begin_s + one->end_s) / 2;
    open_beside(detector, one, other);
    return rl_window_refine(&detector->window, transmission,
                            (middle_s - transmission->start_s) / transmission->bit_s);
}

/* Log likelihood of two packets with steady gains; each is refined. */
static double refine_pair(struct rl_detector *detector, struct rl_verdict *one,
                          struct rl_verdict *other)
{
    double likelihood = -INFINITY;
    for (int round = 0; round < 2; round++) {
        refine_beside(detector, other, one);
        likelihood = refine_beside(detector, one, other);
    }
    return likelihood;
}

/* Make a packet that repeats a lone one, the last that began in its window. */
static void make_lone(struct rl_verdict *verdict)
{
    struct rl_transmission *transmission = &verdict->transmission;
    if (transmission->repeats) {
        transmission->start_s = rl_last_start(transmission, verdict->end_s);
        transmission->repeats = false;
    }
}

/* Whether two packets that repeat may be lone ones of which the last bits are still to come. */
static bool may_be_incomplete(struct rl_detector *detector, struct rl_verdict one,
                              struct rl_verdict other, double own)
{
    if (!one.transmission.repeats || !other.transmission.repeats) {
        return false;
    }
    make_lone(&one);
    make_lone(&other);
    return refine_pair(detector, &one, &other) > own - RL_AS_GOOD;
}

static bool begin_together(const struct rl_transmission *first,
                           const struct rl_transmission *second)
{
    return fabs(rl_bits_later(first, second)) < TOGETHER_BITS;
}

static bool is_packet(const struct rl_codebook *codebook, uint32_t bits)
{
    int word = 0;
    while (word < codebook->words && codebook->packet[word] != bits) {
        word++;
    }
    return word < codebook->words;
}

/* Set both packets of a pair to the same clock. */
static void align(struct rl_transmission *first, struct rl_transmission *second)
{
    const double bit_s = (first->bit_s + second->bit_s) / 2;
    const double half_s = rl_bits_later(first, second) * second->bit_s / 2;
    first->start_s += half_s;
    second->start_s -= half_s;
    first->bit_s = second->bit_s = bit_s;
}

/* By how much two packets that begin together are likelier than all others of the same sum; own:
 * their log likelihood. Of the others, the likeliest by a common clock are refined.
 */
static double margin_to_others(struct rl_detector *detector, struct rl_verdict first,
                               struct rl_verdict second, double own)
{
    const struct rl_codebook *codebook = &detector->search.codebook;
    const uint32_t bits[2] = {first.transmission.bits, second.transmission.bits};
    struct other_pair best[RL_TRIED];
    int kept = 0, others = 0;
    double margin = RL_MAX_MARGIN;
    align(&first.transmission, &second.transmission);
    for (int word = 0; word < codebook->words; word++) {
        const uint32_t flipped = codebook->packet[word] ^ bits[0], differ = bits[0] ^ bits[1];
        if (flipped == 0 || flipped == differ || (flipped & ~differ) != 0 ||
            !is_packet(codebook, bits[1] ^ flipped)) {
            continue;
        }
        if (++others > MAX_OTHERS) {
            return 0.0;
        }
        first.transmission.bits = bits[0] ^ flipped;
        second.transmission.bits = bits[1] ^ flipped;
        open_beside(detector, &first, &second);
        const struct other_pair other = {
            (float)rl_window_try(&detector->window, &first.transmission), flipped};
        rl_keep_best(best, &kept, RL_TRIED, &other, sizeof other);
    }
    for (int i = 0; i < kept; i++) {
        struct rl_verdict one = first, other = second;
        one.transmission.bits = bits[0] ^ best[i].flipped;
        other.transmission.bits = bits[1] ^ best[i].flipped;
        margin = fmin(margin, own - refine_pair(detector, &one, &other));
    }
    return margin;
}

double rl_pair_margin(struct rl_detector *detector, const struct rl_verdict *one,
                      const struct rl_verdict *other)
{
    if (!begin_together(&one->transmission, &other->transmission)) {
        return RL_MAX_MARGIN;
    }
    struct rl_verdict first = *one, second = *other;
    /* A pair and its rivals explain the same samples: those of the lone packet, if one is. */
    const struct rl_verdict *lone = one->transmission.repeats ? other : one;
    first.begin_s = second.begin_s = lone->begin_s;
    first.end_s = second.end_s = lone->end_s;
    const double own = refine_pair(detector, &first, &second);
    return may_be_incomplete(detector, first, second, own)
               ? 0.0
               : margin_to_others(detector, first, second, own);
}

double rl_pair_margin_beside_known(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_pool *pool = &detector->pool;
    const uint64_t zones = detector->samples.channel[verdict->channel].mask;
    const struct rl_packet_train train = rl_train_of(verdict);
    const double packet_s = RL_PACKET_BITS * verdict->transmission.bit_s;
    /* Where known markers continue, others must have begun, each by chance. */
    const int events = rl_pool_followed(pool, verdict->id, &train) != NULL ? 2 : 1;
    const struct rl_interference interference = detector->window.interference;
    double margin = RL_MAX_MARGIN;
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track *track = &pool->track[i];
        if ((track->zones & zones) == 0 || track->id == verdict->id ||
            !begin_together(&track->train.transmission, &verdict->transmission) ||
            track->train.end_s < verdict->begin_s - 2.0 * packet_s) {
            continue;
        }
        struct rl_verdict own_packet = *verdict, other = *verdict;
        other.id = track->id;
        other.transmission = track->train.transmission;
        other.transmission.repeats = true;
        const double own = refine_pair(detector, &own_packet, &other);
        margin = fmin(margin, events * RL_COST_OF_CHANCE +
                                  margin_to_others(detector, own_packet, other, own));
    }
    detector->window.interference = interference;
    return margin;
}
