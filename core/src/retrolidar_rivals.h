/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets of other IDs that may have been sent. */
#ifndef RETROLIDAR_RIVALS_H
#define RETROLIDAR_RIVALS_H

#include "retrolidar_bits.h"
#include "retrolidar_hits.h"

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
double rl_rivals_margin(struct rl_window *window, const struct rl_codebook *codebook,
                        const struct rl_bits *bits, const struct rl_transmission *transmission,
                        int packets, double own, double half_bits, uint16_t id,
                        const struct rl_hits *hits);

/* The same if the marker of another ID has come or gone in the window, at any time: it is as dark
 * then as with a dark bit.
 */
double rl_rivals_part_margin(struct rl_window *window, const struct rl_codebook *codebook,
                             const struct rl_bits *bits, const struct rl_transmission *transmission,
                             double own, uint16_t id);

#endif
