/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The word test: whether flipped bits, or other sequences of bits, are likelier than a packet. */
#include "retrolidar_decide.h"

#include <math.h>

enum { FLIPS = 4 }; /* bits that are flipped to make a better sequence */

static bool is_dark(const struct rl_transmission *transmission, int bit)
{
    return (transmission->bits & rl_packet_bit(rl_bit_of(bit))) != 0;
}

struct rl_bits rl_bits_cut(const struct rl_transmission *transmission, int first, int silent)
{
    struct rl_bits bits = {.count = silent + RL_PACKET_BITS, .silent = silent, .first = first};
    bits.begin_s = transmission->start_s + (first - silent) * transmission->bit_s;
    for (int bit = silent; bit < bits.count; bit++) {
        bits.dark[bit] = is_dark(transmission, first + bit - silent);
    }
    if (transmission->repeats) {
        bits.dark_before = is_dark(transmission, first - 1);
        bits.dark_after = bits.dark[silent];
    } else {
        bits.dark_before = transmission->dark_before;
        bits.dark_after = transmission->dark_after;
    }
    return bits;
}

double rl_word_sequence(const struct rl_case *judged, double too_much)
{
    double better = -INFINITY;
    for (int i = 0; i < judged->hits->sequences && better <= too_much; i++) {
        struct rl_transmission any = judged->hits->sequence[i];
        const double likelihood = rl_window_refine(judged->window, &any, judged->half_bits);
        better = fmax(better, likelihood - judged->log_likelihood);
    }
    return better;
}

double rl_word_flip_bits(struct rl_case *judged, double too_much)
{
    struct rl_bits *bits = &judged->bits;
    float *flipped = bits->flipped + bits->silent;
    struct rl_transmission best = judged->verdict.transmission;
    double better = 0.0;
    for (int round = 0; round < FLIPS && better <= too_much; round++) {
        uint32_t best_flip = 0;
        for (int bit = 0; bit < RL_PACKET_BITS && better <= too_much; bit++) {
            float *alone = &flipped[rl_bit_of(bit - bits->first)];
            if (round > 0 && *alone <= -(float)RL_MAX_MARGIN) {
                continue;
            }
            struct rl_transmission other = best;
            other.bits ^= rl_packet_bit(bit);
            const double gained = rl_window_try(judged->window, &other) - judged->log_likelihood;
            *alone = round == 0 ? (float)gained : *alone;
            if (gained > better) {
                better = gained;
                best_flip = rl_packet_bit(bit);
            }
        }
        best.bits ^= best_flip;
        if (best_flip == 0) {
            break;
        }
    }
    /* A dark bit in the silence is not tried: it changes about as much as the packet's second bit,
     * which is dark.
     */
    for (int bit = 0; bit < bits->silent; bit++) {
        bits->flipped[bit] = flipped[rl_bit_of(1 - bits->first)];
    }
    return better;
}
