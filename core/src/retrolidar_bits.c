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

static void flip_bits(struct rl_case *judged)
{
    struct rl_bits *bits = &judged->bits;
    struct rl_window *window = judged->window;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    float second = 0.0f; /* of the packet's second bit, which is dark */
    for (int bit = bits->count - 1; bit >= 0; bit--) {
        if (bit < bits->silent) {
            /* A dark bit in the silence is not tried: it changes about as much as in the packet. */
            bits->flipped[bit] = second;
        } else {
            const int of = rl_bit_of(bits->first + bit - bits->silent);
            struct rl_transmission other = *transmission;
            other.bits ^= rl_packet_bit(of);
            bits->flipped[bit] = (float)(rl_window_try(window, &other) - judged->own);
            second = of == 1 ? bits->flipped[bit] : second;
        }
    }
}

double rl_word_sequence(const struct rl_case *judged)
{
    double best = -INFINITY;
    for (int i = 0; i < judged->hits->sequences; i++) {
        struct rl_transmission any = judged->hits->sequence[i];
        best = fmax(best, rl_window_refine(judged->window, &any, judged->half_bits));
    }
    return best;
}

double rl_word_flip_bits(struct rl_case *judged)
{
    const struct rl_bits *bits = &judged->bits;
    const double enough = 3.0 * judged->thresholds->word;
    struct rl_transmission best = judged->verdict.transmission;
    double better = 0.0;
    float first[RL_PACKET_BITS]; /* of each bit of the packet */
    flip_bits(judged);
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        first[rl_bit_of(bits->first + bit)] = bits->flipped[bits->silent + bit];
    }
    for (int round = 0; round < FLIPS && better < enough; round++) {
        uint32_t flipped = 0;
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            if (round > 0 && first[bit] <= -(float)RL_MAX_MARGIN) {
                continue;
            }
            struct rl_transmission other = best;
            other.bits ^= rl_packet_bit(bit);
            const double gained = round == 0
                                      ? (double)first[bit]
                                      : rl_window_try(judged->window, &other) - judged->own;
            if (gained > better) {
                better = gained;
                flipped = rl_packet_bit(bit);
            }
        }
        if (flipped == 0) {
            break;
        }
        best.bits ^= flipped;
    }
    return better;
}

double rl_word_packets(const struct rl_case *judged)
{
    struct rl_window *window = judged->window;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    const double enough = 2.0 * judged->thresholds->word;
    const double bit_s = transmission->bit_s, packet_s = RL_PACKET_BITS * bit_s;
    const double first = floor((window->begin_s[0] - transmission->start_s) / packet_s);
    const double newest_s = window->begin_s[window->rows - 1];
    const double last = floor((newest_s - transmission->start_s) / packet_s);
    double better = 0.0;
    for (int bit = 0; bit < RL_PACKET_BITS && better < enough; bit++) {
        const uint32_t bits = transmission->bits ^ rl_packet_bit(bit);
        for (double packet = first; packet <= last; packet++) {
            const double at_s = transmission->start_s + packet * packet_s + bit * bit_s;
            /* The crystal is slow, so the bit after it changes, too. */
            const double other = rl_window_try_stretch(window, transmission, bits,
                                                       at_s - bit_s / 2, at_s + 2.0 * bit_s);
            better += fmax(other - judged->own - RL_COST_OF_GAIN, 0.0);
        }
    }
    return better;
}
