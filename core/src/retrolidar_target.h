/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The samples of one channel in a window, of the target that may be a marker. */
#ifndef RETROLIDAR_TARGET_H
#define RETROLIDAR_TARGET_H

#include "retrolidar_samples.h"

/* Samples of a channel, row by row: those that are held, or a changed copy. */
struct rl_column {
    const float *signal;
    const uint8_t *valid;
    bool has_two_targets; /* whether the zone reports two targets by turns */
};

/* Memory for the changed copy. */
struct rl_room {
    float *signal;
    uint8_t *valid;
};

void rl_room_start(struct rl_room *room, int rows, struct rl_memory *memory);

/* Find the column of a channel. If a zone reports two targets in turn, the marker is one of them.
 * While the other one is reported, the marker is dark; but if the marker is the dimmer one, and the
 * other one is brighter, its state is unknown. A nearer target that is seen for a short while hides
 * the marker: erasures.
 *
 * is_dimmer: whether the marker is the dimmer one of the two
 */
struct rl_column rl_target_column(const struct rl_samples *samples, int channel, int first,
                                  int rows, bool is_dimmer, struct rl_room *room);

#endif
