/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The samples of one channel in a window, of that target which may be a marker. */
#ifndef RETROLIDAR_TARGET_H
#define RETROLIDAR_TARGET_H

#include "retrolidar_samples.h"

/* Samples of a channel, row by row: where they are held, or where there was room to change them. */
struct rl_column {
    const float *signal;
    const uint8_t *valid;
};

/* Room for a column that is changed. */
struct rl_room {
    float *signal;
    uint8_t *valid;
};

void rl_room_start(struct rl_room *room, int rows, struct rl_memory *memory);

/* Find the column of a channel. Where a zone reports two targets by turns, the dimmer one is what
 * is seen while the marker is dark: however bright it is, the marker is dark. One that is nearer
 * and seen for a short while hides the marker: erasures.
 */
struct rl_column rl_target_column(const struct rl_samples *samples, int channel, int first,
                                  int rows, struct rl_room *room);

#endif
