/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The host's end of the serial line (retrolidar_wire.h), as the Python code cannot do it fast
 * enough for many sensors.
 */
#ifndef RETROLIDAR_RECEIVE_H
#define RETROLIDAR_RECEIVE_H

#include <stddef.h>
#include <stdint.h>

/* binding */
/* Undo COBS; return how many bytes were written, less than length, or -1 - i if byte i is wrong. */
int32_t rl_cobs_decode(const uint8_t *encoded, size_t length, uint8_t *data);

/* Read the zones of a packet with rows * rows of them, 11 bytes each, into arrays in the order of
 * the scene. A distance is NaN where there is no target.
 *
 * distance: [m]; signal, ambient: [kcps/SPAD]
 */
void rl_wire_zones(const uint8_t *zones, uint32_t rows, float *distance, float *signal,
                   float *ambient, uint8_t *status);
/* end of binding */

#endif
