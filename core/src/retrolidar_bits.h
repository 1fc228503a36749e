/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A window cut into the bits of a packet, and what each does for the likelihood. */
#ifndef RETROLIDAR_BITS_H
#define RETROLIDAR_BITS_H

#include "retrolidar_observation.h"

enum { RL_MAX_BITS = RL_SILENT_BITS + RL_PACKET_BITS }; /* that a window is cut into */

/* In the order of time: a packet's bits, and the silence before, too. */
struct rl_bits {
    int count, silent;
    int first;      /* which bit of the packet follows the silence */
    double begin_s; /* of the first of all [s] */
    bool dark[RL_MAX_BITS];
    bool dark_before, dark_after; /* the first and the last */
    /* Log likelihood if a bit were the other one, less that as it is. */
    float flipped[RL_MAX_BITS];
};

/* Cut a window into the bits of a packet. */
struct rl_bits rl_bits_cut(const struct rl_transmission *transmission, int first, int silent);

/* Flip each bit that is seen in a part of the window, before a row or from it on; the others tell
 * nothing. From row 0 on, all are seen.
 *
 * own: log likelihood of the packet if it is seen in that part only
 */
void rl_bits_flip(struct rl_bits *bits, struct rl_window *window,
                  const struct rl_transmission *transmission, double own, int split, bool later);

/* What the dark bits of another packet, which begins at a bit of the window, would do [nats], all
 * bright first; return the sum of that.
 */
float rl_bits_weigh(const struct rl_bits *bits, int begin, bool repeats,
                    float weight[RL_PACKET_BITS]);

float rl_bits_sum(uint32_t packet, const float weight[RL_PACKET_BITS]);

/* What no packet exceeds. */
float rl_bits_max(const float weight[RL_PACKET_BITS]);

#endif
