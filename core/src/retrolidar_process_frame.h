/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What is searched when: after each frame, the channels in which a packet may have ended or come.
 */
#ifndef RETROLIDAR_PROCESS_FRAME_H
#define RETROLIDAR_PROCESS_FRAME_H

#include "retrolidar_detector_state.h"

/* Search the newest samples, and judge what is found, the most promising first. */
void rl_process_frame(struct rl_detector *detector);

#endif
