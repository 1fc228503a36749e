/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How much better other sequences of bits are than a packet, whether they are of a word or not. */
#ifndef RETROLIDAR_WORD_H
#define RETROLIDAR_WORD_H

#include "retrolidar_decide.h"

/* Log likelihood of the best sequence of bits that the search has found. */
double rl_word_sequence(const struct rl_case *judged);

/* How much better a sequence is that differs from the packet in a few bits, if not by far [nats].
 */
double rl_word_flip_bits(const struct rl_case *judged);

/* How much better packets that repeat are explained if each has bits of its own, if not by far. */
double rl_word_packets(const struct rl_case *judged);

#endif
