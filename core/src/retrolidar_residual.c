/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Signals of zones less the packets that were read in them, to find fainter ones (successive
 * interference cancellation).
 */
#include "retrolidar_detector_state.h"

#include <string.h>

void rl_residual_start(struct rl_residual *residual, struct rl_samples *samples,
                       struct rl_window *window, struct rl_memory *memory)
{
    residual->samples = samples;
    residual->window = window;
    residual->saved =
        rl_take(memory, samples->channels * (int64_t)samples->kept, sizeof *residual->saved);
}

/* Variance of a channel over the newest rows, over that of its noise. */
static double variation(const struct rl_residual *residual, int channel)
{
    const struct rl_samples *samples = residual->samples;
    const int rows = samples->count - residual->first;
    const int newest = samples->variance_rows < rows ? samples->variance_rows : rows;
    const float *rest = samples->signal + rl_sample(samples, channel, samples->count - newest);
    const double mean = rl_mean(rest, newest);
    double squares = 0.0;
    for (int row = 0; row < newest; row++) {
        squares += ((double)rest[row] - mean) * ((double)rest[row] - mean);
    }
    return newest > 1 ? squares / (newest - 1) / rl_noise_variance(samples, channel, mean) : 0.0;
}

/* Save the samples of a channel; return how many rows these are. */
static int save(struct rl_residual *residual, int channel)
{
    const struct rl_samples *samples = residual->samples;
    const int rows = samples->count - residual->first;
    memcpy(residual->saved + (size_t)channel * (size_t)samples->kept,
           samples->signal + rl_sample(samples, channel, residual->first),
           (size_t)rows * sizeof(float));
    return rows;
}

/* The same of a zone, since a time. */
static int save_since(struct rl_residual *residual, int zone, double from_s)
{
    const int oldest = rl_samples_oldest(residual->samples);
    residual->first = rl_samples_row(residual->samples, from_s);
    residual->first = residual->first > oldest ? residual->first : oldest;
    return save(residual, zone);
}

/* An erasure repeats the sample before it, as in the samples that are held. */
static void fill_missing(float *signal, const uint8_t *valid, int rows)
{
    for (int row = 1; row < rows; row++) {
        signal[row] = valid[row] ? signal[row] : signal[row - 1];
    }
}

double rl_residual_subtract(struct rl_residual *residual, int zone,
                            const struct rl_interference *interference, double from_s)
{
    struct rl_samples *samples = residual->samples;
    struct rl_window *window = residual->window;
    const int rows = save_since(residual, zone, from_s);
    float *signal = samples->signal + rl_sample(samples, zone, residual->first);
    window->interference = *interference;
    window->beside = NULL;
    rl_window_open(window, zone, false, samples->begin_s[residual->first],
                   samples->end_s[samples->count - 1]);
    memmove(signal, window->column.signal, (size_t)rows * sizeof *signal);
    rl_unwhiten(&window->whitened, signal);
    fill_missing(signal, window->column.valid, rows);
    /* Without the packet, the targets could not be told apart any more. */
    samples->interference_removed[zone] = true;
    return variation(residual, zone);
}

double rl_residual_sum(struct rl_residual *residual, int channel)
{
    struct rl_samples *samples = residual->samples;
    const struct rl_channel *sum = &samples->channel[channel];
    const int rows = save(residual, channel);
    float *signal = samples->signal + rl_sample(samples, channel, residual->first);
    memset(signal, 0, (size_t)rows * sizeof *signal);
    for (int i = 0; i < sum->zones; i++) {
        const float *zone = samples->signal + rl_sample(samples, sum->zone[i], residual->first);
        for (int row = 0; row < rows; row++) {
            signal[row] += zone[row];
        }
    }
    return variation(residual, channel);
}

void rl_residual_restore(struct rl_residual *residual, int zone)
{
    struct rl_samples *samples = residual->samples;
    const size_t rows = (size_t)(samples->count - residual->first);
    memcpy(samples->signal + rl_sample(samples, zone, residual->first),
           residual->saved + (size_t)zone * (size_t)samples->kept, rows * sizeof(float));
    samples->interference_removed[zone] = false;
}
