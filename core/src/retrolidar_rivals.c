/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The margin test: packets of other IDs, alone or one after the other. */
#include "retrolidar_decide.h"

#include "retrolidar_math.h"

#include <math.h>
#include <string.h>

struct rival {
    float nats; /* approximate log likelihood, less that of the packet that is judged */
    struct rl_transmission transmission;
};

struct rivals {
    int count;
    struct rival best[RL_TRIED];
};

/* Add the effect of flipping a bit of the window to the bit of another packet there, if any. */
static void add_weight(float weight[RL_PACKET_BITS], int of, bool repeats, bool dark, float flipped)
{
    of = repeats ? rl_bit_of(of) : of;
    if (of >= 0 && of < RL_PACKET_BITS) {
        weight[of] += dark ? -flipped : flipped;
    }
}

/* Find the effect of each dark bit of another packet that begins at `begin`; return that of no dark
 * bits [nats].
 */
static float weigh(const struct rl_bits *bits, int begin, bool repeats,
                   float weight[RL_PACKET_BITS])
{
    float all = 0.0f;
    memset(weight, 0, RL_PACKET_BITS * sizeof *weight);
    for (int bit = 0; bit < bits->count; bit++) {
        all += bits->dark[bit] ? bits->flipped[bit] : 0.0f;
        add_weight(weight, bit - begin, repeats, bits->dark[bit], bits->flipped[bit]);
    }
    /* Exposures at the ends also see the bits beyond, which are better as they are. */
    add_weight(weight, -1 - begin, repeats, bits->dark_before, -(float)RL_AS_GOOD);
    add_weight(weight, bits->count - begin, repeats, bits->dark_after, -(float)RL_AS_GOOD);
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

/* A bound for all packets. */
static float max_of(const float weight[RL_PACKET_BITS])
{
    float most = rl_add_preamble(0.0f, weight);
    for (int bit = RL_PREAMBLE_BITS; bit < RL_PACKET_BITS; bit++) {
        most += fmaxf(weight[bit], 0.0f);
    }
    return most;
}

/* Find the packet, not of the ID in question, that is likeliest if it begins at a bit of the
 * window, by the sum over the bits that it flips.
 */
static void find_rival(const struct rl_case *judged, int begin, bool repeats,
                       struct rivals *rivals)
{
    const struct rl_bits *bits = &judged->bits;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    float weight[RL_PACKET_BITS];
    const float all = weigh(bits, begin, repeats, weight);
    const float most = all + max_of(weight);
    const bool is_full = rivals->count == RL_TRIED;
    if (most < -(float)RL_MAX_MARGIN || (is_full && most <= rivals->best[RL_TRIED - 1].nats)) {
        return;
    }
    const int word = rl_codebook_heaviest(judged->codebook, weight, judged->verdict.id);
    if (word < 0) {
        return;
    }
    const uint32_t packet = judged->codebook->packet[word];
    const bool in_its_place = !repeats && begin == bits->silent;
    const struct rl_transmission other = {
        .bits = packet,
        .repeats = repeats,
        .start_s = bits->begin_s + begin * transmission->bit_s,
        .bit_s = transmission->bit_s,
        .dark_before = in_its_place && transmission->dark_before,
        .dark_after = in_its_place && transmission->dark_after,
    };
    const struct rival rival = {all + sum_of(packet, weight), other};
    if (rival.nats > -(float)RL_MAX_MARGIN) {
        rl_keep_best(rivals->best, &rivals->count, RL_TRIED, &rival, sizeof rival);
    }
}

/* Find packets that repeat and, in a window of one packet, lone ones. */
static struct rivals find_rivals(const struct rl_case *judged)
{
    struct rivals rivals = {.count = 0};
    for (int begin = 0; begin < RL_PACKET_BITS; begin++) {
        find_rival(judged, begin, true, &rivals);
    }
    if (judged->verdict.packets == 1) {
        for (int begin = 1 - RL_PACKET_BITS; begin < judged->bits.count; begin++) {
            find_rival(judged, begin, false, &rivals);
        }
    }
    return rivals;
}

/* The greater of `nearest` and the log likelihood of a packet, which is refined if it is near. */
static double nearer_of(const struct rl_case *judged, struct rl_transmission other, double nearest)
{
    double likelihood = rl_window_try(judged->window, &other);
    if (likelihood > nearest - RL_MAX_MARGIN / 2) {
        likelihood = rl_window_refine(judged->window, &other, judged->half_bits);
    }
    return fmax(nearest, likelihood);
}

double rl_rivals_margin(const struct rl_case *judged)
{
    const struct rivals rivals = find_rivals(judged);
    const struct rl_hits *hits = judged->hits;
    double nearest = judged->log_likelihood - RL_MAX_MARGIN;
    for (int i = 0; i < rivals.count; i++) {
        nearest = nearer_of(judged, rivals.best[i].transmission, nearest);
    }
    for (int i = 0; i < hits->count; i++) {
        if (hits->hit[i].id != judged->verdict.id) {
            nearest = nearer_of(judged, hits->hit[i].transmission, nearest);
        }
    }
    if (!judged->verdict.transmission.repeats && !judged->follows) {
        nearest = fmax(nearest, rl_rivals_next(judged));
    }
    return judged->log_likelihood - nearest;
}

/* The same if markers are seen in a part of the window only: before a row, or from it on. */
static double margin_of_part(const struct rl_case *judged, int split, bool later)
{
    struct rl_window *window = judged->window;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    if (rl_window_try_part(window, transmission, split, later) <
        judged->log_likelihood - RL_MAX_MARGIN) {
        return RL_MAX_MARGIN;
    }
    struct rl_case part = *judged;
    for (int bit = 0; bit < part.bits.count; bit++) {
        const double middle_s = part.bits.begin_s + (bit + 0.5) * transmission->bit_s;
        if ((middle_s < window->begin_s[split]) == later) {
            part.bits.flipped[bit] = 0.0f;
        }
    }
    const struct rivals rivals = find_rivals(&part);
    double nearest = judged->log_likelihood - RL_MAX_MARGIN;
    for (int i = 0; i < rivals.count; i++) {
        const struct rl_transmission *other = &rivals.best[i].transmission;
        nearest = fmax(nearest, rl_window_try_part(window, other, split, later));
    }
    return judged->log_likelihood - nearest;
}

double rl_rivals_part_margin(const struct rl_case *judged)
{
    const int parts = RL_PARTS * (judged->bits.count + RL_PACKET_BITS / 2) / RL_PACKET_BITS;
    double margin = RL_MAX_MARGIN;
    for (int later = 0; later < 2; later++) {
        for (int part = 1; part < parts; part++) {
            const int split = part * judged->window->rows / parts;
            margin = fmin(margin, RL_COST_OF_CHANCE + margin_of_part(judged, split, later));
        }
    }
    return margin;
}

/* Two packets, where one ends and the other begins, and how likely they are about. */
struct two_packets {
    double nats, price;
    int end, word[2];
};

/* Find the likeliest two packets back to back, by the sums over the bits that they flip. The
 * shorter part fits some ID by chance, which has a price. One ID twice is a packet that repeats,
 * which is tried by itself.
 */
static struct two_packets find_two(const struct rl_case *judged)
{
    const struct rl_codebook *codebook = judged->codebook;
    const int count = judged->bits.count;
    struct two_packets best = {.nats = -RL_MAX_MARGIN, .end = -1};
    for (int end = 1; end < count; end++) {
        float weight[2][RL_PACKET_BITS], part[2];
        const float all = weigh(&judged->bits, end - RL_PACKET_BITS, false, weight[0]);
        weigh(&judged->bits, end, false, weight[1]);
        struct two_packets two = {.end = end};
        for (int i = 0; i < 2; i++) {
            part[i] = max_of(weight[i]); /* a bound until its word is found */
        }
        for (int i = 0; i < 2 && (double)(all + part[0] + part[1]) > best.nats; i++) {
            two.word[i] = rl_codebook_heaviest(codebook, weight[i], judged->verdict.id);
            part[i] = two.word[i] < 0 ? -INFINITY
                                      : sum_of(codebook->packet[two.word[i]], weight[i]);
        }
        const int seen = end < count - end ? end : count - end;
        two.price = log(2.0) * (seen < RL_ID_BITS ? seen : RL_ID_BITS);
        two.nats = (double)(all + part[0] + part[1]) - two.price;
        if (two.nats > best.nats) {
            best = two;
        }
    }
    return best;
}

/* How likely two packets are at best, each shifted, as they need not keep time with the bits. */
static double shift_two(struct rl_window *window, struct rl_transmission *one,
                        struct rl_transmission *other)
{
    double best = rl_window_try_two(window, one, other);
    for (int moved = 0; moved < 2; moved++) {
        struct rl_transmission *packet = moved ? one : other;
        const double start_s = packet->start_s;
        double best_s = start_s;
        for (int phase = -RL_PHASES / 2; phase <= RL_PHASES / 2; phase++) {
            packet->start_s = start_s + phase * packet->bit_s / RL_PHASES;
            const double likelihood = rl_window_try_two(window, one, other);
            if (likelihood > best) {
                best = likelihood;
                best_s = packet->start_s;
            }
        }
        packet->start_s = best_s;
    }
    return best;
}

double rl_rivals_successive_margin(const struct rl_case *judged)
{
    const struct two_packets two = find_two(judged);
    if (two.end < 0) {
        return RL_MAX_MARGIN;
    }
    const int begin[2] = {two.end - RL_PACKET_BITS, two.end};
    const double bit_s = judged->verdict.transmission.bit_s;
    struct rl_transmission packet[2];
    for (int i = 0; i < 2; i++) {
        packet[i] = (struct rl_transmission){.bits = judged->codebook->packet[two.word[i]],
                                             .start_s = judged->bits.begin_s + begin[i] * bit_s,
                                             .bit_s = bit_s};
    }
    const double likelihood = shift_two(judged->window, &packet[0], &packet[1]);
    return fmin(judged->log_likelihood + two.price - likelihood, RL_MAX_MARGIN);
}
