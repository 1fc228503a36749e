/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How much better other sequences of bits are than a packet, whether they are of a word or not. */
#ifndef RETROLIDAR_WORD_H
#define RETROLIDAR_WORD_H

#include "retrolidar_bits.h"
#include "retrolidar_hits.h"

/* Log likelihood of the best sequence of bits that the search has found. */
double rl_word_sequence(struct rl_window *window, double half_bits, const struct rl_hits *hits);

/* How much better a sequence is that differs from the packet in a few bits.
 *
 * own: log likelihood of the packet
 * enough: if one is better by so much, others are not asked [nats]
 */
double rl_word_flip_bits(struct rl_window *window, const struct rl_transmission *transmission,
                         double own, const struct rl_bits *bits, double enough);

/* How much better packets that repeat are explained if each has bits of its own; not more exactly
 * than that it is enough [nats].
 */
double rl_word_packets(struct rl_window *window, const struct rl_transmission *transmission,
                       double own, double enough);

#endif
