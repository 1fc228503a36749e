/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A window cut into the bits of a packet, and what each does for the likelihood. */
#ifndef RETROLIDAR_BITS_H
#define RETROLIDAR_BITS_H

#include "retrolidar_decide.h"

/* Cut a window into the bits of a packet. */
struct rl_bits rl_bits_cut(const struct rl_transmission *transmission, int first, int silent);

/* Flip each bit that is seen in a part of the window, before a row or from it on; the others tell
 * nothing. From row 0 on, all are seen. `own` is of a packet that is seen in that part only.
 */
void rl_bits_flip(struct rl_case *judged, int split, bool later);

/* What the dark bits of another packet, which begins at a bit of the window, would do [nats], all
 * bright first; return the sum of that.
 */
float rl_bits_weigh(const struct rl_bits *bits, int begin, bool repeats,
                    float weight[RL_PACKET_BITS]);

float rl_bits_sum(uint32_t packet, const float weight[RL_PACKET_BITS]);

/* What no packet exceeds. */
float rl_bits_max(const float weight[RL_PACKET_BITS]);

#endif
