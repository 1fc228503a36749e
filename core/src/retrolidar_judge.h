/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What becomes of a hit of the search: it is read, alone or with one that it hides, or rejected. */
#ifndef RETROLIDAR_JUDGE_H
#define RETROLIDAR_JUDGE_H

#include "retrolidar_detector_state.h"

/* Judge the best hit of a channel, and what it may hide. */
void rl_judge(struct rl_detector *detector, const struct rl_pending *pending, double to_s);

#endif
