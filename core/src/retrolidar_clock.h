/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether what blinks keeps the clock of our packets: a marker of another bit period, or anything
 * else that blinks, may look like one of them.
 */
#ifndef RETROLIDAR_CLOCK_H
#define RETROLIDAR_CLOCK_H

#include "retrolidar_window.h"

/* By how much any bits of another clock explain a window better than a packet [nats]. A bit that
 * there are more of than in a packet costs what it says.
 *
 * own: log likelihood of the packet
 */
double rl_clock_excess(struct rl_window *window, const struct rl_transmission *transmission,
                       double own);

/* By how much a channel correlates better with itself some other time before than a packet's length
 * before, over all rows that are held [nats]. Packets that are combined are too faint to ask which
 * bits each of them has.
 */
double rl_clock_period_excess(struct rl_window *window, const struct rl_transmission *transmission);

#endif
