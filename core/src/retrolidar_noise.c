/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_noise.h"

#include "retrolidar_math.h"

#include <math.h>
#include <stddef.h>

/* Samples are white if neighbours correlate by less; so they do by chance, 0 +- 0.13. */
static const double WHITE = 0.15;
static const int LEAST_WHITE_ZONES = 3;
static const double LEAST_SCALE = 1.0 / 16, MOST_SCALE = 16.0;
static const double NEWEST_SHARE = 0.2; /* of what is learnt of the scale, later on */

static void change_sums(struct rl_samples *samples, int row, double sign)
{
    for (int source = 0; source < samples->sources; source++) {
        const double value = samples->signal[rl_sample(samples, source, row)];
        samples->sum[source] += sign * value;
        samples->square[source] += sign * value * value;
    }
}

void rl_noise_follow(struct rl_samples *samples, int wanted, bool recompute)
{
    if (recompute || samples->variance_rows > wanted) {
        for (int source = 0; source < samples->sources; source++) {
            samples->sum[source] = samples->square[source] = 0.0;
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

double rl_noise_variance(const struct rl_samples *samples, int source, double signal)
{
    const struct rl_noise_law *law = &samples->law;
    const double zones = samples->source[source].zones;
    return zones * (law->floor + law->ambient * samples->ambient) + law->slope * fmax(signal, 0.0);
}

double rl_noise_variation(const struct rl_samples *samples, int source)
{
    const double rows = samples->variance_rows;
    if (rows < 2.0) {
        return 0.0;
    }
    const double mean = samples->sum[source] / rows;
    const double variance = (samples->square[source] - samples->sum[source] * mean) / (rows - 1.0);
    return variance / (samples->noise_scale * rl_noise_variance(samples, source, mean));
}

void rl_noise_learn(struct rl_samples *samples)
{
    double scales[RL_MOST_ZONES];
    int white = 0;
    const int rows = samples->variance_rows;
    const int first = samples->count - rows;
    if (rows < 16) {
        return;
    }
    for (int zone = 0; zone < samples->zones; zone++) {
        const double mean = samples->sum[zone] / rows;
        const float *signal = samples->signal + rl_sample(samples, zone, first);
        const uint8_t *valid = samples->valid + rl_sample(samples, zone, first);
        double power = 0.0, lagged = 0.0, before = 0.0;
        bool whole = true;
        for (int row = 0; row < rows && whole; row++) {
            const double deviation = (double)signal[row] - mean;
            power += deviation * deviation;
            lagged += deviation * before;
            before = deviation;
            whole = valid[row] ||
                    samples->stamp_ns[first + row] == RL_NO_FRAME; /* a lost frame is no reason */
        }
        if (!whole || !(power > 0.0) || lagged >= WHITE * power) {
            continue;
        }
        /* What a weak marker adds is alike in the two samples of a bit, and cancels here. */
        scales[white++] =
            (power - 2.0 * lagged) / (rows - 1) / rl_noise_variance(samples, zone, mean);
    }
    if (white < LEAST_WHITE_ZONES) {
        return;
    }
    const double scale = fmin(fmax(rl_median(scales, white), LEAST_SCALE), MOST_SCALE);
    const double share = fmax(NEWEST_SHARE, 1.0 / ++samples->lessons);
    samples->noise_scale += share * (scale - samples->noise_scale);
}
