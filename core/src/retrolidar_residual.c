/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Signals of zones less the packets that were read in them, to find fainter ones (successive
 * interference cancellation).
 */
#include "retrolidar_detector_state.h"

#include <string.h>

void rl_residual_start(struct rl_residual *residual, struct rl_samples *samples,
                       struct rl_memory *memory)
{
    const int64_t rows = samples->kept;
    residual->samples = samples;
    residual->light[0] = rl_take(memory, rows, sizeof *residual->light[0]);
    residual->light[1] = rl_take(memory, rows, sizeof *residual->light[1]);
    residual->part = rl_take(memory, rows, sizeof *residual->part);
    residual->saved = rl_take(memory, samples->channels * rows, sizeof *residual->saved);
    rl_room_start(&residual->room, samples->kept, memory);
}

/* Subtract one marker, as far as it was read, or as if it continued. */
static void subtract(struct rl_residual *residual, const struct rl_interference *interference,
                     int marker, float *signal, const uint8_t *valid, int rows)
{
    const struct rl_samples *samples = residual->samples;
    const double *begin_s = samples->begin_s + residual->first;
    const double *end_s = samples->end_s + residual->first;
    double gain[2][RL_KNOTS];
    struct rl_gain_profile profile[2];
    for (int continues = 0; continues < 2; continues++) {
        double *light = residual->light[continues];
        rl_interference_light(interference, marker, continues, begin_s, end_s, rows, residual->part,
                              light);
        profile[continues] = rl_gain_profile_fit(signal, valid, light, rows, gain[continues]);
    }
    /* Another packet would explain about half of it, too, as all begin with the preamble. */
    const double expected =
        profile[0].cross / profile[0].energy * (profile[1].energy - profile[0].energy);
    const int form = profile[1].cross - profile[0].cross > RL_MOST * expected;
    if (!(profile[form].nats > 0.0)) {
        return;
    }
    for (int row = 0; row < rows; row++) {
        const double dark = 1.0 - residual->light[form][row];
        signal[row] += (float)(rl_gain_profile_at(gain[form], row, rows) * dark);
    }
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
    const int rows = save_since(residual, zone, from_s);
    const size_t at = rl_sample(samples, zone, residual->first);
    float *signal = samples->signal + at;
    /* Without the packet, the targets could not be told apart any more. */
    const struct rl_column column =
        rl_target_column(samples, zone, residual->first, rows, false, &residual->room);
    memmove(signal, column.signal, (size_t)rows * sizeof *signal);
    samples->interference_removed[zone] = true;
    for (int i = 0; i < interference->count; i++) {
        if (interference->marker[i] == i) {
            subtract(residual, interference, i, signal, column.valid, rows);
        }
    }
    fill_missing(signal, column.valid, rows);
    return variation(residual, zone);
}

double rl_residual_cancel(struct rl_residual *residual, int zone, int reference, double from_s)
{
    struct rl_samples *samples = residual->samples;
    const int rows = save_since(residual, zone, from_s);
    const size_t at = rl_sample(samples, zone, residual->first);
    float *signal = samples->signal + at;
    struct rl_column column = {signal, samples->valid + at, false};
    double gain[RL_KNOTS];
    rl_reference_light(samples, reference, residual->first, rows, residual->light[0]);
    rl_reference_erase(samples, reference, residual->first, rows, &residual->room, &column);
    if (rl_gain_profile_fit(signal, column.valid, residual->light[0], rows, gain).nats > 0.0) {
        samples->interference_removed[zone] = true;
        for (int row = 0; row < rows; row++) {
            signal[row] -= (float)(rl_gain_profile_at(gain, row, rows) * residual->light[0][row]);
        }
        fill_missing(signal, column.valid, rows);
    }
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
