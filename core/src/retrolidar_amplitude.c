/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_amplitude.h"

#include <math.h>

/* Slope of the signal over light whose mean is 0. */
static double rise_with(const struct rl_seen *seen, const double *light)
{
    double cross = 0.0, energy = 1e-9;
    for (int row = 0; row < seen->rows; row++) {
        cross += light[row] * (double)seen->signal[row];
        energy += light[row] * light[row];
    }
    return cross / energy;
}

void rl_fit_amplitude(const struct rl_samples *samples, const struct rl_seen *seen, int zone,
                      struct rl_amplitude *amplitude)
{
    double of_other[RL_MAX_OTHERS], count = 0.0, signal = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        count += seen->valid[row];
        signal += seen->valid[row] ? (double)seen->signal[row] : 0.0;
    }
    signal /= fmax(count, 1.0);
    /* A hand that passes gives a zone without a target a few samples, which any gain fits. Fewer
     * than the bits in which words differ tell none.
     */
    const bool is_known = count >= RL_WORD_DISTANCE;
    const double energy = fmax(is_known ? rl_orthogonalise(seen, seen->valid) : 0.0, 1e-9);
    const double rise = is_known ? rise_with(seen, seen->alone) : 0.0;
    for (int i = 0; i < seen->others; i++) {
        of_other[i] = is_known ? rise_with(seen, seen->other + i * seen->rows) : 0.0;
    }
    double power = 0.0, alike = 0.0, before = 0.0, dark = 0.0, sum = 0.0, squares = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        double left = (double)seen->signal[row] - signal - rise * seen->alone[row];
        for (int i = 0; i < seen->others; i++) {
            left -= of_other[i] * seen->other[i * seen->rows + row];
        }
        left = seen->valid[row] ? left : 0.0;
        power += left * left;
        alike += left * before;
        before = left;
        if (seen->valid[row] && seen->light[row] < 1.0 - RL_BRIGHT) {
            dark += 1.0;
            sum += left;
            squares += left * left;
        }
    }
    /* The residual may be another marker, whose samples are correlated. The noise is at least that
     * of the sensor's quantisation.
     */
    const double step = seen->sensor->signal_step;
    const double noise = fmax(power / fmax(count - 2.0, 1.0), step * step / 12.0);
    const double known = rl_noise_variance(samples, zone, signal);
    const double of_dark =
        fmax(dark > 2.0 ? (squares - sum * sum / dark) / (dark - 1.0) : noise, known);
    amplitude->of[zone] = rise;
    amplitude->noise[zone] = noise;
    amplitude->unknown[zone] = sqrt((of_dark - known) * count / energy);
    amplitude->score[zone] = fmax(rise, 0.0) / sqrt(rise * rise + power / energy + 1e-30);
    const double samples_alike = 1.0 + 2.0 * fmax(alike / fmax(power, 1e-9), 0.0);
    amplitude->variance[zone] = noise * samples_alike / energy;
    amplitude->dark_variance[zone] = of_dark * samples_alike / energy;
}
