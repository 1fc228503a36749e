/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Lone packets that stand out and are judged again later: before they have ended, or before stretches
 * of them may be left out, another one may look like them.
 */
#ifndef RETROLIDAR_WAITING_H
#define RETROLIDAR_WAITING_H

#include "retrolidar_detector_state.h"

/* Remember the strongest one of a source. */
void rl_waiting_note(struct rl_detector *detector, int source, const struct rl_verdict *verdict,
                     double to_s);

/* Add those to the candidates that have just ended, and again `RL_LATER_BITS` after that. */
void rl_waiting_add(struct rl_detector *detector, double from_s, double to_s);

#endif
