/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The samples that a packet is judged by: from when to when, and whether they are enough. */
#ifndef RETROLIDAR_OBSERVATION_H
#define RETROLIDAR_OBSERVATION_H

#include "retrolidar_decide.h"

/* Open the window that a packet was found in, and refine it; for a lone packet that with the
 * silence before it, if it is the better one. Find evidence, begin, end, fit and where they are.
 */
void rl_observation_open(struct rl_case *judged);

/* Whether too many samples are erasures to decide the word. */
bool rl_observation_is_erased(const struct rl_case *judged);

#endif
