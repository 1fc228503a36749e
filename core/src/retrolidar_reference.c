/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_reference.h"

#include "retrolidar_math.h"

void rl_reference_light(const struct rl_samples *samples, int zone, int first, int rows,
                        double *light)
{
    const float *signal = samples->signal + rl_sample(samples, zone, first);
    float darkest = signal[0];
    for (int row = 1; row < rows; row++) {
        darkest = rl_minf(darkest, signal[row]);
    }
    for (int row = 0; row < rows; row++) {
        light[row] = (double)signal[row] - (double)darkest;
    }
}

void rl_reference_erase(const struct rl_samples *samples, int zone, int first, int rows,
                        struct rl_room *room, struct rl_column *column)
{
    const uint8_t *valid = samples->valid + rl_sample(samples, zone, first);
    for (int row = 0; row < rows; row++) {
        room->signal[row] = column->signal[row];
        room->valid[row] = column->valid[row] & valid[row];
    }
    *column = (struct rl_column){room->signal, room->valid, column->is_parted};
}
