/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_bits.h"

#include <math.h>
#include <string.h>

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

void rl_bits_flip(struct rl_case *judged, int split, bool later)
{
    struct rl_bits *bits = &judged->bits;
    struct rl_window *window = judged->window;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    const double split_s = window->begin_s[split];
    float second = 0.0f; /* what the packet's second bit does, which is dark */
    for (int bit = bits->count - 1; bit >= 0; bit--) {
        const double middle_s = bits->begin_s + (bit + 0.5) * transmission->bit_s;
        if (split > 0 && (middle_s < split_s) == later) {
            bits->flipped[bit] = 0.0f;
        } else if (bit < bits->silent) {
            /* What a dark bit there would do is not tried: about as much as in the packet. */
            bits->flipped[bit] = second;
        } else {
            const int of = rl_bit_of(bits->first + bit - bits->silent);
            struct rl_transmission other = *transmission;
            other.bits ^= rl_packet_bit(of);
            bits->flipped[bit] =
                (float)(rl_window_try_part(window, &other, split, later) - judged->own);
            second = of == 1 ? bits->flipped[bit] : second;
        }
    }
}

/* Add what a bit does if it is flipped to what the packet does that has it, if any. */
static void add_weight(float weight[RL_PACKET_BITS], int of, bool repeats, bool dark, float flipped)
{
    of = repeats ? rl_bit_of(of) : of;
    if (of >= 0 && of < RL_PACKET_BITS) {
        weight[of] += dark ? -flipped : flipped;
    }
}

float rl_bits_weigh(const struct rl_bits *bits, int begin, bool repeats,
                    float weight[RL_PACKET_BITS])
{
    float all = 0.0f;
    memset(weight, 0, RL_PACKET_BITS * sizeof *weight);
    for (int bit = 0; bit < bits->count; bit++) {
        all += bits->dark[bit] ? bits->flipped[bit] : 0.0f;
        add_weight(weight, bit - begin, repeats, bits->dark[bit], bits->flipped[bit]);
    }
    /* Exposures at the ends see some of the bits beyond, which are best as they are. */
    add_weight(weight, -1 - begin, repeats, bits->dark_before, -(float)RL_AS_GOOD);
    add_weight(weight, bits->count - begin, repeats, bits->dark_after, -(float)RL_AS_GOOD);
    return all;
}

float rl_bits_sum(uint32_t packet, const float weight[RL_PACKET_BITS])
{
    float nats = 0.0f;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        nats += packet & rl_packet_bit(bit) ? weight[bit] : 0.0f;
    }
    return nats;
}

float rl_bits_max(const float weight[RL_PACKET_BITS])
{
    float most = rl_add_preamble(0.0f, weight);
    for (int bit = RL_PREAMBLE_BITS; bit < RL_PACKET_BITS; bit++) {
        most += fmaxf(weight[bit], 0.0f);
    }
    return most;
}
