/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_rivals.h"

#include "retrolidar_refine.h"

#include <math.h>
#include <stddef.h>

struct rival {
    float nats; /* about, less those of the packet in question */
    struct rl_transmission transmission;
};

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

/* Find the packet, not of the ID in question, that is likeliest if it begins at a bit of the
 * window, by the sum over the bits that it turns.
 */
static void find_rival(const struct rl_codebook *codebook, const struct rl_bits *bits,
                       const struct rl_transmission *transmission, uint16_t id, int begin,
                       bool repeats, struct rival *rivals)
{
    float weight[RL_PACKET_BITS];
    const float all = rl_bits_weigh(bits, begin, repeats, weight);
    const float most = all + rl_bits_max(weight);
    if (most < -(float)RL_MAX_MARGIN || most <= rivals[RL_TRIED - 1].nats) {
        return;
    }
    const int word = rl_codebook_heaviest(codebook, weight, id);
    if (word < 0) {
        return;
    }
    const float nats = all + rl_bits_sum(codebook->packet[word], weight);
    const bool in_its_place = !repeats && begin == 0;
    const struct rl_transmission other = {
        .bits = codebook->packet[word],
        .repeats = repeats,
        .start_s = bits->begin_s + begin * transmission->bit_s,
        .bit_s = transmission->bit_s,
        .dark_before = in_its_place && transmission->dark_before,
        .dark_after = in_its_place && transmission->dark_after,
    };
    keep_rival(rivals, (struct rival){nats, other});
}

/* Find packets that are seen in a window, lone if it is one packet long, or repeating. */
static void find_rivals(const struct rl_codebook *codebook, const struct rl_bits *bits,
                        const struct rl_transmission *transmission, int packets, uint16_t id,
                        struct rival rivals[RL_TRIED])
{
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
}

double rl_rivals_margin(struct rl_window *window, const struct rl_codebook *codebook,
                        const struct rl_bits *bits, const struct rl_transmission *transmission,
                        int packets, double own, double half_bits, uint16_t id,
                        const struct rl_hits *hits)
{
    struct rival rivals[RL_TRIED];
    find_rivals(codebook, bits, transmission, packets, id, rivals);
    double nearest = own - RL_MAX_MARGIN;
    for (int i = 0; i < RL_TRIED + hits->count; i++) {
        const struct rl_hit *hit = i < RL_TRIED ? NULL : &hits->hit[i - RL_TRIED];
        if (hit == NULL ? !(rivals[i].nats > -RL_MAX_MARGIN) : hit->id == id) {
            continue;
        }
        struct rl_transmission other = hit == NULL ? rivals[i].transmission : hit->transmission;
        double likelihood = rl_window_try(window, &other);
        if (likelihood > nearest - RL_MAX_MARGIN / 2) {
            likelihood = rl_window_refine(window, &other, half_bits);
        }
        nearest = fmax(nearest, likelihood);
    }
    return own - nearest;
}

/* The same where markers are seen in a part of the window only: before a row, or from it on. */
static double margin_of_part(struct rl_window *window, const struct rl_codebook *codebook,
                             const struct rl_bits *bits, const struct rl_transmission *transmission,
                             double own, uint16_t id, int split, bool later)
{
    const double part = rl_window_try_part(window, transmission, split, later);
    if (part < own - RL_MAX_MARGIN) {
        return RL_MAX_MARGIN;
    }
    struct rl_bits seen = *bits;
    rl_bits_flip(&seen, window, transmission, part, split, later);
    struct rival rivals[RL_TRIED];
    find_rivals(codebook, &seen, transmission, 1, id, rivals);
    double nearest = own - RL_MAX_MARGIN;
    for (int i = 0; i < RL_TRIED && rivals[i].nats > -(float)RL_MAX_MARGIN; i++) {
        nearest = fmax(nearest,
                       rl_window_try_part(window, &rivals[i].transmission, split, later));
    }
    return own - nearest;
}

double rl_rivals_part_margin(struct rl_window *window, const struct rl_codebook *codebook,
                             const struct rl_bits *bits, const struct rl_transmission *transmission,
                             double own, uint16_t id)
{
    const int parts = RL_PARTS * (bits->count + RL_PACKET_BITS / 2) / RL_PACKET_BITS;
    double margin = RL_MAX_MARGIN;
    for (int later = 0; later < 2; later++) {
        for (int part = 1; part < parts; part++) {
            margin = fmin(margin, RL_COST_OF_CHANCE +
                                      margin_of_part(window, codebook, bits, transmission, own, id,
                                                     part * window->rows / parts, later));
        }
    }
    return margin;
}
