/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a packet that was judged is of the samples of each zone. */
#ifndef RETROLIDAR_SHARES_H
#define RETROLIDAR_SHARES_H

#include "retrolidar_decide.h"

struct rl_shares {
    const struct rl_samples *samples;
    struct rl_window *window; /* whose columns are used */
    double *light;            /* of a packet in each row */
};

int64_t rl_shares_bytes(int rows);
void rl_shares_start(struct rl_shares *shares, const struct rl_samples *samples,
                     struct rl_window *window, void *memory);

/* Find the zones that saw a packet, and how strongly; of a sum those with a part in it. Return how
 * many there are; both arrays are of RL_MAX_ZONES.
 */
int rl_shares_zones(struct rl_shares *shares, const struct rl_verdict *verdict, int *zones,
                    double *gains);

#endif
