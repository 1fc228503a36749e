/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The samples that a packet is judged by: from when to when, and whether they are enough. */
#ifndef RETROLIDAR_OBSERVATION_H
#define RETROLIDAR_OBSERVATION_H

#include "retrolidar_constants.h"
#include "retrolidar_window.h"

/* Before a lone packet, which show its bright level. */
enum { RL_SILENT_BITS = RL_PACKET_BITS };

/* Bits from the start of what is sent to the middle of the window that it was found in. */
double rl_observation_half_bits(const struct rl_transmission *transmission, int packets,
                                double to_s);

/* Open the window that a packet was found in, and refine it; for a lone packet that with the
 * silence before it, if it is the better one. Return its evidence.
 *
 * consumed_until_s: before that, samples are of what was read [s]
 * since_s: and before that they are left out [s]
 * silent_bits: set to how many the window has before the packet
 */
double rl_observation_open(struct rl_window *window, int channel,
                           struct rl_transmission *transmission, int packets,
                           double consumed_until_s, double since_s, double to_s, int *silent_bits);

/* Whether too many samples are erasures to decide the word. */
bool rl_observation_is_erased(const struct rl_window *window,
                              const struct rl_transmission *transmission);

#endif
