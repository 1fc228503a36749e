/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Which zones saw a packet that was judged. */
#ifndef RETROLIDAR_ZONES_H
#define RETROLIDAR_ZONES_H

#include "retrolidar_decide.h"

/* Find the zones that saw a packet, and how strongly; of a sum those with a part in it. Return how
 * many there are; both arrays are of RL_MAX_ZONES. The window's interference is the verdict's.
 */
int rl_zones_of_packet(struct rl_window *window, const struct rl_verdict *verdict, int *zones,
                       double *strength);

#endif
