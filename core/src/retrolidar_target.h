/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The samples of one source in a window, of that target which may be a marker. */
#ifndef RETROLIDAR_TARGET_H
#define RETROLIDAR_TARGET_H

#include "retrolidar_samples.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Copy the column of a source. Where a zone reports two targets by turns, the dimmer one is what is
 * seen while the marker is dark: however bright it is, the marker is dark. One that is nearer and
 * seen for a short while hides the marker: erasures.
 *
 * scratch: of `rows` floats
 */
void rl_target_column(const struct rl_samples *samples, int source, int first, int rows,
                      float *signal, uint8_t *valid, float *scratch);

#ifdef __cplusplus
}
#endif

#endif
