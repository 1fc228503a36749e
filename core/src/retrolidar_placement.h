/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* When and where the marker of a reading is, from what all zones saw of it. */
#ifndef RETROLIDAR_PLACEMENT_H
#define RETROLIDAR_PLACEMENT_H

#include "retrolidar_detector.h"

/* Place the marker of a reading of the frame that was taken last; false where no distance was
 * measured. Every zone that has read it gives its range, and all zones around the strongest its
 * bearing.
 */
bool rl_place(struct rl_detector *detector, const struct rl_reading *reading,
              struct rl_placement *placement);

#endif
