/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_rivals.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

enum { FLIPS = 4 }; /* bits that are flipped to make a better sequence */

/* The bits that are seen of a packet that ended may be any, as far as they are of its ID [nats]. */
static const double COST_OF_BIT = 0.6931471805599453;
/* Nobody asks for more, so it need not be known exactly [nats]. */
static const double ENOUGH = 30.0;

struct rival {
    float nats; /* about, less those of the packet in question */
    struct rl_transmission transmission;
};

double rl_rivals_sequence(struct rl_window *window, const struct rl_transmission *transmission,
                          double half_bits, const struct rl_hits *hits)
{
    double best = -INFINITY;
    for (int i = 0; i < hits->sequences; i++) {
        const struct rl_sequence *sequence = &hits->sequence[i];
        struct rl_transmission any = {sequence->bits, sequence->repeats, sequence->start_s,
                                      sequence->bit_s, transmission->brightening_s};
        best = fmax(best, rl_window_refine(window, &any, half_bits));
    }
    return best;
}

double rl_rivals_flip_bits(struct rl_window *window, const struct rl_transmission *transmission,
                           double own, int begin, int silent_bits, double enough,
                           struct rl_bits *bits)
{
    double better = 0.0;
    float first[RL_PACKET_BITS]; /* of each bit of the packet */
    uint32_t sequence = transmission->bits;
    bits->count = silent_bits + RL_PACKET_BITS;
    bits->begin_s = transmission->start_s + (begin - silent_bits) * transmission->bit_s;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        const uint32_t flipped = rl_packet_bit((begin + bit) % RL_PACKET_BITS);
        bits->dark[silent_bits + bit] = (sequence & flipped) != 0;
        bits->flipped[silent_bits + bit] =
            (float)(rl_window_try_bits(window, transmission, sequence ^ flipped) - own);
        first[(begin + bit) % RL_PACKET_BITS] = bits->flipped[silent_bits + bit];
    }
    for (int bit = 0; bit < silent_bits; bit++) {
        /* What a dark bit there would do is not tried: about as much as in the packet. */
        bits->dark[bit] = false;
        bits->flipped[bit] = first[1];
    }
    for (int round = 0; round < FLIPS && better < enough; round++) {
        int best = -1;
        double most = better;
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            if (round == 0 || first[bit] > -ENOUGH) {
                const uint32_t other = sequence ^ rl_packet_bit(bit);
                const double gained = round == 0
                                          ? (double)first[bit]
                                          : rl_window_try_bits(window, transmission, other) - own;
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

static void keep_rival(struct rival *rivals, struct rival kept)
{
    for (int i = 0; i < RL_TRIED; i++) {
        if (kept.nats > rivals[i].nats) {
            const struct rival worse = rivals[i];
            rivals[i] = kept;
            kept = worse;
        }
    }
}

/* What the bits of a packet that begins at a bit of the window would do [nats]; all bright first,
 * the sum of which is returned.
 */
static float weigh(const struct rl_bits *bits, int begin, bool repeats,
                   float weight[RL_PACKET_BITS])
{
    float all = 0.0f;
    memset(weight, 0, RL_PACKET_BITS * sizeof *weight);
    for (int bit = 0; bit < bits->count; bit++) {
        all += bits->dark[bit] ? bits->flipped[bit] : 0.0f;
        int of = bit - begin;
        if (repeats) {
            of = (of % RL_PACKET_BITS + RL_PACKET_BITS) % RL_PACKET_BITS;
        }
        if (of >= 0 && of < RL_PACKET_BITS) {
            weight[of] += bits->dark[bit] ? -bits->flipped[bit] : bits->flipped[bit];
        }
    }
    return all;
}

static float sum_of(uint32_t packet, const float weight[RL_PACKET_BITS])
{
    float nats = 0.0f;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        nats += packet & rl_packet_bit(bit) ? weight[bit] : 0.0f;
    }
    return nats;
}

/* What no packet exceeds with such bits. */
static float max_sum(const float weight[RL_PACKET_BITS])
{
    float most = rl_add_preamble(0.0f, weight);
    for (int bit = RL_PREAMBLE_BITS; bit < RL_PACKET_BITS; bit++) {
        most += fmaxf(weight[bit], 0.0f);
    }
    return most;
}

/* Find the packet, not of the ID in question, that is likeliest if it begins at a bit of the
 * window, by the sum over the bits that it turns.
 */
static void find_rival(const struct rl_codebook *codebook, const struct rl_bits *bits,
                       const struct rl_transmission *transmission, uint16_t id, int begin,
                       bool repeats, struct rival *rivals)
{
    float weight[RL_PACKET_BITS];
    const float all = weigh(bits, begin, repeats, weight);
    const float most = all + max_sum(weight);
    if (most < -(float)ENOUGH || most <= rivals[RL_TRIED - 1].nats) {
        return;
    }
    const int word = rl_codebook_heaviest(codebook, weight, id);
    if (word < 0) {
        return;
    }
    const float nats = all + sum_of(codebook->packet[word], weight);
    const struct rl_transmission other = {codebook->packet[word], repeats,
                                          bits->begin_s + begin * transmission->bit_s,
                                          transmission->bit_s, transmission->brightening_s};
    keep_rival(rivals, (struct rival){nats, other});
}

double rl_rivals_margin(struct rl_window *window, const struct rl_codebook *codebook,
                        const struct rl_bits *bits, const struct rl_transmission *transmission,
                        int packets, double own, double half_bits, uint16_t id,
                        const struct rl_hits *hits)
{
    struct rival rivals[RL_TRIED];
    for (int i = 0; i < RL_TRIED; i++) {
        rivals[i].nats = -INFINITY;
    }
    for (int begin = 1 - RL_PACKET_BITS; begin < bits->count; begin++) {
        if (packets == 1) {
            find_rival(codebook, bits, transmission, id, begin, false, rivals);
        }
        if (transmission->repeats && begin >= 0) {
            find_rival(codebook, bits, transmission, id, begin, true, rivals);
        }
    }
    double nearest = own - ENOUGH;
    for (int i = 0; i < RL_TRIED + hits->count; i++) {
        const struct rl_hit *hit = i < RL_TRIED ? NULL : &hits->hit[i - RL_TRIED];
        if (hit == NULL ? !(rivals[i].nats > -ENOUGH) : hit->id == id) {
            continue;
        }
        struct rl_transmission other =
            hit == NULL ? rivals[i].transmission
                        : (struct rl_transmission){rl_packet(hit->id), hit->repeats, hit->start_s,
                                                   hit->bit_s, transmission->brightening_s};
        double likelihood = rl_window_try(window, &other);
        if (likelihood > nearest - ENOUGH / 2) {
            likelihood = rl_window_refine(window, &other, half_bits);
        }
        nearest = fmax(nearest, likelihood);
    }
    return own - nearest;
}

double rl_rivals_sequence_margin(struct rl_window *window, const struct rl_codebook *codebook,
                                 const struct rl_bits *bits,
                                 const struct rl_transmission *transmission, double own,
                                 uint16_t id)
{
    struct rl_transmission best[2];
    double most = -ENOUGH, cost = 0.0;
    for (int begin = 1; begin < bits->count; begin++) {
        float weight[2][RL_PACKET_BITS];
        const float all = weigh(bits, begin - RL_PACKET_BITS, false, weight[0]);
        weigh(bits, begin, false, weight[1]);
        const double price = COST_OF_BIT * (begin < RL_ID_BITS ? begin : RL_ID_BITS);
        if ((double)(all + max_sum(weight[0]) + max_sum(weight[1])) - price <= most) {
            continue;
        }
        const int ended = rl_codebook_heaviest(codebook, weight[0], id);
        const int begun = rl_codebook_heaviest(codebook, weight[1], id);
        if (ended < 0 || begun < 0) {
            continue;
        }
        const uint32_t packet[2] = {codebook->packet[ended], codebook->packet[begun]};
        const double nats =
            (double)(all + sum_of(packet[0], weight[0]) + sum_of(packet[1], weight[1])) - price;
        for (int i = 0; nats > most && i < 2; i++) {
            best[i] = (struct rl_transmission){packet[i], false,
                                               bits->begin_s + (begin + (i - 1) * RL_PACKET_BITS) *
                                                                   transmission->bit_s,
                                               transmission->bit_s, transmission->brightening_s};
        }
        cost = nats > most ? price : cost;
        most = fmax(most, nats);
    }
    if (most <= -ENOUGH) {
        return ENOUGH;
    }
    return own + cost - rl_window_try_two(window, &best[0], &best[1]);
}

double rl_rivals_part_margin(struct rl_window *window, const struct rl_codebook *codebook,
                             const struct rl_bits *bits, const struct rl_transmission *transmission,
                             double own, uint16_t id)
{
    const int parts = RL_PARTS * (bits->count + RL_PACKET_BITS / 2) / RL_PACKET_BITS;
    struct rival rivals[RL_TRIED];
    double margin = ENOUGH;
    for (int later = 0; later < 2; later++) {
        int split = -1;
        for (int part = 1; part < parts; part++) {
            const int row = (later ? part : parts - part) * window->rows / parts;
            if (rl_window_try_part(window, transmission, row, later) < own - RL_AS_GOOD) {
                break;
            }
            split = row;
        }
        if (split < 0) {
            continue;
        }
        struct rl_bits seen = *bits;
        const double split_s = window->samples->begin_s[window->first + split];
        for (int bit = 0; bit < bits->count; bit++) {
            if ((bits->begin_s + (bit + 0.5) * transmission->bit_s < split_s) == later) {
                seen.flipped[bit] = 0.0f;
            }
        }
        for (int i = 0; i < RL_TRIED; i++) {
            rivals[i].nats = -INFINITY;
        }
        for (int begin = 1 - RL_PACKET_BITS; begin < bits->count; begin++) {
            find_rival(codebook, &seen, transmission, id, begin, transmission->repeats, rivals);
        }
        margin = fmin(margin, RL_COST_OF_CHANCE - (double)rivals[0].nats);
    }
    return margin;
}
