/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A packet that was read may be sent on and on: then others in its zone are seen without it only. */
#ifndef RETROLIDAR_GOING_ON_H
#define RETROLIDAR_GOING_ON_H

#include "retrolidar_shares.h"

/* What was read in a source. */
struct rl_going_on {
    uint16_t id; /* 0: nothing was read */
    struct rl_sending sending;
    double gain;
    double begin_s, end_s; /* of the first of its readings that follow each other, and of the last */
};

/* Remember what was read as the newest of a source. */
void rl_going_on_add(struct rl_going_on going_on[RL_GOING_ON], const struct rl_verdict *read,
                     double gain);

struct rl_hit rl_going_on_hit(const struct rl_going_on *going_on);

/* Whether a source varies less in its last packet's time without what went on.
 *
 * known: set to what can be taken off
 * rest: set to how the source varies then, over what is noise
 */
bool rl_going_on_is_sent(const struct rl_going_on *going_on, struct rl_shares *shares, int source,
                         double to_s, struct rl_verdict *known, double *rest);

#endif
