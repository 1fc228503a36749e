/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_rivals.h"

#include "retrolidar_bits.h"
#include "retrolidar_math.h"

#include <math.h>

struct rival {
    float nats; /* about, less those of the packet in question */
    struct rl_transmission transmission;
};

struct rivals {
    int count;
    struct rival best[RL_TRIED];
};

/* Find the packet, not of the ID in question, that is likeliest if it begins at a bit of the
 * window, by the sum over the bits that it turns.
 */
static void find_rival(const struct rl_case *judged, int begin, bool repeats,
                       struct rivals *rivals)
{
    const struct rl_bits *bits = &judged->bits;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    float weight[RL_PACKET_BITS];
    const float all = rl_bits_weigh(bits, begin, repeats, weight);
    const float most = all + rl_bits_max(weight);
    const bool is_full = rivals->count == RL_TRIED;
    if (most < -(float)RL_MAX_MARGIN || (is_full && most <= rivals->best[RL_TRIED - 1].nats)) {
        return;
    }
    const int word = rl_codebook_heaviest(judged->codebook, weight, judged->verdict.id);
    if (word < 0) {
        return;
    }
    const uint32_t packet = judged->codebook->packet[word];
    const bool in_its_place = !repeats && begin == 0;
    const struct rl_transmission other = {
        .bits = packet,
        .repeats = repeats,
        .start_s = bits->begin_s + begin * transmission->bit_s,
        .bit_s = transmission->bit_s,
        .dark_before = in_its_place && transmission->dark_before,
        .dark_after = in_its_place && transmission->dark_after,
    };
    const struct rival rival = {all + rl_bits_sum(packet, weight), other};
    if (rival.nats > -(float)RL_MAX_MARGIN) {
        rl_keep_best(rivals->best, &rivals->count, RL_TRIED, &rival, sizeof rival);
    }
}

/* Find packets that are seen in a window, lone if it is one packet long, or repeating. */
static struct rivals find_rivals(const struct rl_case *judged)
{
    struct rivals rivals = {.count = 0};
    for (int begin = 1 - RL_PACKET_BITS; begin < judged->bits.count; begin++) {
        if (judged->verdict.packets == 1) {
            find_rival(judged, begin, false, &rivals);
        }
        if (judged->verdict.transmission.repeats && begin >= 0) {
            find_rival(judged, begin, true, &rivals);
        }
    }
    return rivals;
}

/* The greater one of a likelihood and that of a packet, refined if it is near. */
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
    double nearest = judged->own - RL_MAX_MARGIN;
    for (int i = 0; i < rivals.count; i++) {
        nearest = nearer_of(judged, rivals.best[i].transmission, nearest);
    }
    for (int i = 0; i < hits->count; i++) {
        if (hits->hit[i].id != judged->verdict.id) {
            nearest = nearer_of(judged, hits->hit[i].transmission, nearest);
        }
    }
    return judged->own - nearest;
}

/* The same where markers are seen in a part of the window only: before a row, or from it on. */
static double margin_of_part(const struct rl_case *judged, int split, bool later)
{
    struct rl_window *window = judged->window;
    struct rl_case part = *judged;
    part.own = rl_window_try_part(window, &judged->verdict.transmission, split, later);
    if (part.own < judged->own - RL_MAX_MARGIN) {
        return RL_MAX_MARGIN;
    }
    rl_bits_flip(&part, split, later);
    const struct rivals rivals = find_rivals(&part);
    double nearest = judged->own - RL_MAX_MARGIN;
    for (int i = 0; i < rivals.count; i++) {
        const struct rl_transmission *other = &rivals.best[i].transmission;
        nearest = fmax(nearest, rl_window_try_part(window, other, split, later));
    }
    return judged->own - nearest;
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
