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
    bool is_parted; /* whether the zone reports two targets by turns */
};

/* Room for a column that is changed. */
struct rl_room {
    float *signal;
    uint8_t *valid;
};

void rl_room_start(struct rl_room *room, int rows, struct rl_memory *memory);

/* Find the column of a channel. Where a zone reports two targets by turns, the marker is one of
 * them. While the other one is seen, which outshines it, the marker is dark, or not known if the
 * other one is brighter than the marker is at times. A target that is nearer and seen for a short
 * while hides the marker: erasures.
 *
 * is_dimmer: whether the marker is the dimmer one of the two
 */
struct rl_column rl_target_column(const struct rl_samples *samples, int channel, int first,
                                  int rows, bool is_dimmer, struct rl_room *room);

/* Adaptive interference cancelling (Widrow et al. 1975): a zone beside sees what interferes, too,
 * and more of it. Its signal stands for light of which neither ID nor clock need be known.
 */
enum { RL_NO_REFERENCE = -1 };

/* What a zone sees in some rows beyond its darkest. */
void rl_reference_light(const struct rl_samples *samples, int zone, int first, int rows,
                        double *light);

/* Erase the samples of a column in whose rows the reference has none. */
void rl_reference_erase(const struct rl_samples *samples, int zone, int first, int rows,
                        struct rl_room *room, struct rl_column *column);

#endif
