/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_word.h"

#include "retrolidar_refine.h"

#include <math.h>

enum { FLIPS = 4 }; /* bits that are flipped to make a better sequence */

double rl_word_sequence(struct rl_window *window, double half_bits, const struct rl_hits *hits)
{
    double best = -INFINITY;
    for (int i = 0; i < hits->sequences; i++) {
        struct rl_transmission any = hits->sequence[i];
        best = fmax(best, rl_window_refine(window, &any, half_bits));
    }
    return best;
}

double rl_word_flip_bits(struct rl_window *window, const struct rl_transmission *transmission,
                         double own, const struct rl_bits *bits, double enough)
{
    double better = 0.0;
    float first[RL_PACKET_BITS]; /* of each bit of the packet */
    uint32_t sequence = transmission->bits;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        first[(bits->first + bit) % RL_PACKET_BITS] = bits->flipped[bits->silent + bit];
    }
    for (int round = 0; round < FLIPS && better < enough; round++) {
        int best = -1;
        double most = better;
        for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
            if (round == 0 || first[bit] > -(float)RL_MAX_MARGIN) {
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

double rl_word_packets(struct rl_window *window, const struct rl_transmission *transmission,
                         double own, double enough)
{
    const double *begin_s = window->samples->begin_s + window->first;
    const double bit_s = transmission->bit_s, packet_s = RL_PACKET_BITS * bit_s;
    const double first = floor((begin_s[0] - transmission->start_s) / packet_s);
    const double last = floor((begin_s[window->rows - 1] - transmission->start_s) / packet_s);
    double better = 0.0;
    for (int bit = 0; bit < RL_PACKET_BITS && better < enough; bit++) {
        const uint32_t bits = transmission->bits ^ rl_packet_bit(bit);
        for (double packet = first; packet <= last; packet++) {
            const double at_s = transmission->start_s + packet * packet_s + bit * bit_s;
            /* The crystal is slow, so the bit after it changes, too. */
            const double other =
                rl_window_try_stretch(window, transmission, bits, at_s - bit_s / 2,
                                      at_s + 2.0 * bit_s);
            better += fmax(other - own - RL_COST_OF_GAIN, 0.0);
        }
    }
    return better;
}
