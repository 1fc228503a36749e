/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets of other IDs that may have been sent. */
#ifndef RETROLIDAR_RIVALS_H
#define RETROLIDAR_RIVALS_H

#include "retrolidar_decide.h"

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
double rl_rivals_margin(const struct rl_case *judged);

/* The same if the marker of another ID has come or gone in the window, at any time: it is as dark
 * then as with a dark bit.
 */
double rl_rivals_part_margin(const struct rl_case *judged);

/* The same of one that ended in the window, and another that began then. */
double rl_rivals_successive_margin(const struct rl_case *judged);

#endif
