/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Variance of the samples: by the law of the sensor's noise, and as measured. */
#include "retrolidar_samples.h"

#include <math.h>

static void change_sums(struct rl_samples *samples, int row, double sign)
{
    for (int channel = 0; channel < samples->channels; channel++) {
        const double value = samples->signal[rl_sample(samples, channel, row)];
        samples->sum[channel] += sign * value;
        samples->square[channel] += sign * value * value;
    }
}

void rl_noise_follow(struct rl_samples *samples, int wanted, bool recompute)
{
    if (recompute || samples->variance_rows > wanted) {
        for (int channel = 0; channel < samples->channels; channel++) {
            samples->sum[channel] = samples->square[channel] = 0.0;
        }
        samples->variance_rows = 0;
        const int first = samples->count > wanted ? samples->count - wanted : 0;
        for (int row = first; row < samples->count; row++) {
            change_sums(samples, row, 1.0);
            samples->variance_rows++;
        }
        return;
    }
    change_sums(samples, samples->count - 1, 1.0);
    if (samples->variance_rows < wanted) {
        samples->variance_rows++;
    } else {
        change_sums(samples, samples->count - 1 - wanted, -1.0);
    }
}

double rl_noise_variance(const struct rl_samples *samples, int channel, double signal)
{
    const struct rl_sensor *sensor = &samples->sensor;
    const double zones = samples->channel[channel].zones;
    return zones * (sensor->noise_floor + sensor->noise_ambient * samples->ambient) +
           sensor->noise_slope * fmax(signal, 0.0);
}

double rl_noise_variation(const struct rl_samples *samples, int channel)
{
    const double rows = samples->variance_rows;
    if (rows < 2.0) {
        return 0.0;
    }
    const double mean = samples->sum[channel] / rows;
    const double variance =
        (samples->square[channel] - samples->sum[channel] * mean) / (rows - 1.0);
    return variance / rl_noise_variance(samples, channel, mean);
}
