/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Signals of zones less the packets that were read in them, to find fainter ones (successive
 * interference cancellation).
 */
#include "retrolidar_detector_state.h"

#include <string.h>

/* Variance of a channel over the newest rows, over that of its noise. */
static double variation(const struct rl_detector *detector, int channel)
{
    const struct rl_samples *samples = &detector->samples;
    const int rows = samples->count - detector->saved_row;
    const int newest = samples->variance_rows < rows ? samples->variance_rows : rows;
    const float *rest = samples->signal + rl_sample(samples, channel, samples->count - newest);
    const double mean = rl_mean(rest, newest);
    double squares = 0.0;
    for (int row = 0; row < newest; row++) {
        squares += ((double)rest[row] - mean) * ((double)rest[row] - mean);
    }
    return newest > 1 ? squares / (newest - 1) / rl_noise_variance(samples, channel, mean) : 0.0;
}

/* Save the newest samples of a channel; return them, and how many rows these are. */
static float *save(struct rl_detector *detector, int channel, int *rows)
{
    struct rl_samples *samples = &detector->samples;
    float *signal = samples->signal + rl_sample(samples, channel, detector->saved_row);
    *rows = samples->count - detector->saved_row;
    memcpy(detector->saved + (size_t)channel * (size_t)samples->kept, signal,
           (size_t)*rows * sizeof *signal);
    return signal;
}

/* An erasure repeats the sample before it, as in the samples that are held. */
static void fill_missing(float *signal, const uint8_t *valid, int rows)
{
    for (int row = 1; row < rows; row++) {
        signal[row] = valid[row] ? signal[row] : signal[row - 1];
    }
}

double rl_residual_subtract(struct rl_detector *detector, int zone, double since_s, double from_s,
                            const struct rl_verdict *beside)
{
    struct rl_samples *samples = &detector->samples;
    /* Packets are subtracted while none is judged, so they are fitted in a window of these. */
    struct rl_window *window = detector->other_zone;
    const int oldest = rl_samples_oldest(samples), first = rl_samples_row(samples, from_s);
    const uint16_t id = beside != NULL ? beside->id : 0;
    int rows;
    detector->saved_row = first > oldest ? first : oldest;
    float *signal = save(detector, zone, &rows);
    rl_pool_interference(&detector->pool, samples->channel[zone].mask, since_s, id, id,
                         &window->interference);
    if (beside != NULL) {
        rl_interference_add(&window->interference, beside);
    }
    rl_window_open(window, zone, false, samples->begin_s[detector->saved_row],
                   samples->end_s[samples->count - 1]);
    memmove(signal, window->column.signal, (size_t)rows * sizeof *signal);
    rl_unwhiten(&window->whitened, signal);
    fill_missing(signal, window->column.valid, rows);
    /* Without the packet, the targets could not be told apart any more. */
    samples->interference_removed[zone] = true;
    return variation(detector, zone);
}

double rl_residual_sum(struct rl_detector *detector, int channel)
{
    const struct rl_samples *samples = &detector->samples;
    const struct rl_channel *sum = &samples->channel[channel];
    int rows;
    float *signal = save(detector, channel, &rows);
    memset(signal, 0, (size_t)rows * sizeof *signal);
    for (int i = 0; i < sum->zones; i++) {
        const float *zone =
            samples->signal + rl_sample(samples, sum->zone[i], detector->saved_row);
        for (int row = 0; row < rows; row++) {
            signal[row] += zone[row];
        }
    }
    return variation(detector, channel);
}

void rl_residual_restore(struct rl_detector *detector, int channel)
{
    struct rl_samples *samples = &detector->samples;
    const size_t rows = (size_t)(samples->count - detector->saved_row);
    memcpy(samples->signal + rl_sample(samples, channel, detector->saved_row),
           detector->saved + (size_t)channel * (size_t)samples->kept, rows * sizeof(float));
    samples->interference_removed[channel] = false;
}
