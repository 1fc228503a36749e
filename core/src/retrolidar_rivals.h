/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What else may have been sent: other sequences of bits, and packets of other IDs. */
#ifndef RETROLIDAR_RIVALS_H
#define RETROLIDAR_RIVALS_H

#include "retrolidar_hits.h"
#include "retrolidar_observation.h"

enum { RL_MAX_BITS = RL_SILENT_BITS + RL_PACKET_BITS }; /* that a window is cut into */

/* A window cut into the bits of the packet in question, in the order of time. */
struct rl_bits {
    int count;      /* a packet's, and the silence before, too */
    double begin_s; /* of the first [s] */
    /* Log likelihood if a bit were the other one, less that as it is. */
    float flipped[RL_MAX_BITS];
    bool dark[RL_MAX_BITS];
};

/* Log likelihood of the best sequence of bits that the search has found, of a packet or not. */
double rl_rivals_sequence(struct rl_window *window, const struct rl_transmission *transmission,
                          double half_bits, const struct rl_hits *hits);

/* Cut the window into bits and turn each; return how much better another sequence of the packet's
 * own bits may be.
 *
 * own: log likelihood of the packet
 * begin: which bit of the packet the window begins with, after so many silent bits
 * enough: if one is better by so much, others are not asked [nats]
 */
double rl_rivals_flip_bits(struct rl_window *window, const struct rl_transmission *transmission,
                           double own, int begin, int silent_bits, double enough,
                           struct rl_bits *bits);

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
double rl_rivals_margin(struct rl_window *window, const struct rl_codebook *codebook,
                        const struct rl_bits *bits, const struct rl_transmission *transmission,
                        int packets, double own, double half_bits, uint16_t id,
                        const struct rl_hits *hits);

/* The same against packets of other IDs back to back, one of which ended in the window, and the
 * next began.
 */
double rl_rivals_sequence_margin(struct rl_window *window, const struct rl_codebook *codebook,
                                 const struct rl_bits *bits,
                                 const struct rl_transmission *transmission, double own,
                                 uint16_t id);

/* The same if the marker may have appeared or vanished in the window, where the packet is dark at
 * its begin or end: a marker that is not there is as dark. About; infinite if the packet is not.
 */
double rl_rivals_part_margin(struct rl_window *window, const struct rl_codebook *codebook,
                             const struct rl_bits *bits, const struct rl_transmission *transmission,
                             double own, uint16_t id);

#endif
