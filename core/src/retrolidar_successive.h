/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets of other IDs, one after the other, as rivals of one packet. */
#ifndef RETROLIDAR_SUCCESSIVE_H
#define RETROLIDAR_SUCCESSIVE_H

#include "retrolidar_bits.h"
#include "retrolidar_codebook.h"

/* How much likelier a packet is than one of another ID that ended in the window, and one that began
 * then [nats].
 */
double rl_successive_margin(struct rl_window *window, const struct rl_codebook *codebook,
                            const struct rl_bits *bits, const struct rl_transmission *transmission,
                            double own, uint16_t id);

#endif
