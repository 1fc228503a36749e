/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_samples.h"

#include "retrolidar_constants.h"
#include "retrolidar_math.h"
#include "retrolidar_packet.h"

#include <math.h>
#include <string.h>

static const double MIN_EXPOSURE_S = 1e-6;

/* List the zones, and the squares of them; return how many there are. */
static int list_channels(int rows, int columns, struct rl_channel *channel)
{
    int count = 0;
    for (int side = 1; side <= RL_MAX_SIDE; side++) {
        for (int corner = 0; corner < rows * columns; corner++) {
            if (corner / columns + side <= rows && corner % columns + side <= columns) {
                for (int i = 0; i < side * side; i++) {
                    const int zone = corner + i / side * columns + i % side;
                    channel[count].zone[i] = (uint8_t)zone;
                    channel[count].mask |= (uint64_t)1 << zone;
                }
                channel[count++].zones = side * side;
            }
        }
    }
    return count;
}

void rl_samples_start(struct rl_samples *samples, const struct rl_sensor *sensor, int kept,
                      double bit_s, struct rl_memory *memory)
{
    memset(samples, 0, sizeof *samples);
    samples->sensor = *sensor;
    samples->zones = sensor->rows * sensor->columns;
    samples->channels = list_channels(sensor->rows, sensor->columns, samples->channel);
    samples->kept = kept;
    samples->capacity = 4 * kept;
    samples->bit_s = bit_s;
    const int64_t rows = samples->capacity, channels = samples->channels;
    samples->sum = rl_take(memory, channels, sizeof *samples->sum);
    samples->square = rl_take(memory, channels, sizeof *samples->square);
    samples->begin_s = rl_take(memory, rows, sizeof *samples->begin_s);
    samples->end_s = rl_take(memory, rows, sizeof *samples->end_s);
    samples->stamp_ns = rl_take(memory, rows, sizeof *samples->stamp_ns);
    samples->signal = rl_take(memory, channels * rows, sizeof *samples->signal);
    samples->distance = rl_take(memory, samples->zones * rows, sizeof *samples->distance);
    samples->valid = rl_take(memory, channels * rows, 1);
}

void rl_samples_clear(struct rl_samples *samples, int64_t stamp_ns)
{
    samples->origin_ns = stamp_ns;
    samples->count = 0;
    samples->variance_rows = 0;
    samples->steps = 0;
    samples->period_s = samples->bit_s / 2;
    samples->ambient = 0.0;
    for (int channel = 0; channel < samples->channels; channel++) {
        samples->sum[channel] = samples->square[channel] = 0.0;
    }
    for (int zone = 0; zone < samples->zones; zone++) {
        samples->last_seen_s[zone] = -INFINITY;
        samples->last_signal[zone] = 0.0f;
    }
}

/* Move the rows that are kept to the front. */
static void make_room(struct rl_samples *samples)
{
    const int first = samples->count - samples->kept;
    const size_t kept = (size_t)samples->kept, from = (size_t)first;
    for (int channel = 0; channel < samples->channels; channel++) {
        const size_t to = rl_sample(samples, channel, 0);
        memcpy(samples->signal + to, samples->signal + to + from, kept * sizeof(float));
        memcpy(samples->valid + to, samples->valid + to + from, kept);
        if (channel < samples->zones) {
            memcpy(samples->distance + to, samples->distance + to + from, kept * sizeof(float));
        }
    }
    memmove(samples->begin_s, samples->begin_s + from, kept * sizeof(double));
    memmove(samples->end_s, samples->end_s + from, kept * sizeof(double));
    memmove(samples->stamp_ns, samples->stamp_ns + from, kept * sizeof(int64_t));
    samples->count = samples->kept;
}

/* Whether a zone had a target so lately that a packet may have been dark since then. */
static bool may_be_dark(const struct rl_samples *samples, int zone, double time_s)
{
    return time_s - samples->last_seen_s[zone] < RL_MAX_DARK_BITS * samples->bit_s;
}

/* Variance of the newest samples of a zone. */
static double recent_variance(const struct rl_samples *samples, int zone, int row)
{
    const int rows = (int)(RL_LOOK_BITS * samples->bit_s / samples->period_s);
    const int first = row > rows ? row - rows : 0;
    double sum = 0.0, square = 0.0;
    for (int i = first; i <= row; i++) {
        const double signal = (double)samples->signal[rl_sample(samples, zone, i)];
        sum += signal;
        square += signal * signal;
    }
    const double count = row + 1 - first;
    return (square - sum * sum / count) / count;
}

/* A sum is valid if the variance of its erased zones is less than half of its noise. */
static void sum_zones(struct rl_samples *samples, int row)
{
    float signal[RL_MAX_ZONES];
    double unknown[RL_MAX_ZONES];
    for (int zone = 0; zone < samples->zones; zone++) {
        signal[zone] = samples->signal[rl_sample(samples, zone, row)];
        /* A zone without a target for long is dark; it makes the sum no less certain. */
        const bool is_erased = !samples->valid[rl_sample(samples, zone, row)] &&
                               may_be_dark(samples, zone, samples->end_s[row]);
        unknown[zone] = is_erased ? recent_variance(samples, zone, row) : 0.0;
    }
    for (int channel = samples->zones; channel < samples->channels; channel++) {
        const struct rl_channel *sum = &samples->channel[channel];
        float total = 0.0f;
        double variance = 0.0;
        for (int i = 0; i < sum->zones; i++) {
            total += signal[sum->zone[i]];
            variance += unknown[sum->zone[i]];
        }
        samples->signal[rl_sample(samples, channel, row)] = total;
        samples->valid[rl_sample(samples, channel, row)] =
            2.0 * variance < rl_noise_variance(samples, channel, (double)total);
    }
}

/* When a frame was, or would have been. */
static double middle_of(const struct rl_samples *samples, int row)
{
    return samples->stamp_ns[row] != RL_NO_FRAME
               ? (double)(samples->stamp_ns[row] - samples->origin_ns) * 1e-9
               : (samples->begin_s[row] + samples->end_s[row]) / 2;
}

/* Place a row about a time; exposures never overlap. */
static int place_row(struct rl_samples *samples, double middle_s, int64_t stamp_ns)
{
    const int row = samples->count++;
    const double half_s = samples->sensor.exposure * samples->period_s / 2;
    samples->begin_s[row] = middle_s - half_s;
    samples->end_s[row] = middle_s + half_s;
    if (row > 0 && samples->begin_s[row] < samples->end_s[row - 1]) {
        const double before_s = middle_of(samples, row - 1);
        const double between_s =
            fmax((before_s + middle_s) / 2, samples->begin_s[row - 1] + MIN_EXPOSURE_S);
        samples->end_s[row - 1] = samples->begin_s[row] = between_s;
        samples->end_s[row] = fmax(samples->end_s[row], between_s + MIN_EXPOSURE_S);
    }
    samples->stamp_ns[row] = stamp_ns;
    return row;
}

static void fill_row(struct rl_samples *samples, int row, double time_s, const float *signals,
                     const float *distances, const uint8_t *status)
{
    const struct rl_sensor *sensor = &samples->sensor;
    const float max_signal = (float)sensor->max_signal, low_signal = (float)sensor->low_signal;
    const float max_distance_m = (float)sensor->max_distance_m;
    for (int zone = 0; zone < samples->zones; zone++) {
        const size_t at = rl_sample(samples, zone, row);
        float *signal = &samples->signal[at];
        uint8_t *valid = &samples->valid[at];
        const uint8_t meaning = sensor->meaning[status[zone]];
        const float s = signals[zone], d = distances[zone];
        const bool normal = meaning == RL_VALID;
        const bool possible =
            s >= 0.0f && s <= max_signal && ((d > 0.0f && d < max_distance_m) || isnan(d));
        samples->impossible += normal && !possible;
        *valid = normal && possible;
        samples->distance[at] = *valid ? d : NAN;
        if (*valid) {
            samples->last_seen_s[zone] = time_s;
            samples->last_signal[zone] = *signal = s;
            continue;
        }
        /* A dark marker with nothing behind it returns no light. */
        const bool nothing =
            meaning == RL_NO_TARGET || (meaning == RL_LOW_SIGNAL && !(s >= low_signal));
        *valid = nothing && may_be_dark(samples, zone, time_s);
        *signal = nothing ? 0.0f : samples->last_signal[zone];
    }
    sum_zones(samples, row);
}

static void fill_gap(struct rl_samples *samples, int row)
{
    for (int channel = 0; channel < samples->channels; channel++) {
        const size_t at = rl_sample(samples, channel, row);
        samples->signal[at] = samples->signal[at - 1];
        samples->valid[at] = 0;
        if (channel < samples->zones) {
            samples->distance[at] = NAN;
        }
    }
}

static void follow_period(struct rl_samples *samples, double step_s)
{
    const uint32_t newest = sizeof samples->step_s / sizeof *samples->step_s;
    samples->step_s[samples->steps % newest] = (float)fmax(step_s, MIN_EXPOSURE_S);
    if (++samples->steps % newest == 0) {
        float steps[sizeof samples->step_s / sizeof *samples->step_s];
        memcpy(steps, samples->step_s, sizeof steps);
        const double share = samples->steps == newest ? 1.0 : 0.2;
        const double median_s = (double)rl_select(steps, (int)newest, (int)newest / 2);
        samples->period_s += share * (median_s - samples->period_s);
    }
}

static void follow_ambient(struct rl_samples *samples, const float *ambient)
{
    float values[RL_MAX_ZONES];
    int count = 0;
    for (int zone = 0; zone < samples->zones; zone++) {
        if (isfinite(ambient[zone]) && ambient[zone] >= 0.0f) {
            values[count++] = ambient[zone];
        }
    }
    samples->ambient = count > 0 ? (double)rl_select(values, count, count / 2) : 0.0;
}

void rl_samples_push(struct rl_samples *samples, int64_t stamp_ns, const float *signal,
                     const float *distance, const float *ambient, const uint8_t *status)
{
    const double time_s = (double)(stamp_ns - samples->origin_ns) * 1e-9;
    if (samples->count > 0) {
        const double before_s = middle_of(samples, samples->count - 1);
        const double periods =
            fmin((time_s - before_s) / samples->period_s + 0.4, samples->kept / 2);
        follow_period(samples, time_s - before_s);
        const int rows = periods < 1.0 ? 1 : (int)periods;
        const double step_s = (time_s - before_s) / rows;
        for (int missing = 1; missing < rows; missing++) {
            if (samples->count == samples->capacity) {
                make_room(samples);
            }
            const int row = place_row(samples, before_s + missing * step_s, RL_NO_FRAME);
            fill_gap(samples, row);
            rl_noise_follow(samples, samples->variance_rows, false);
        }
    }
    const bool full = samples->count == samples->capacity;
    if (full) {
        make_room(samples);
    }
    const int row = place_row(samples, time_s, stamp_ns);
    fill_row(samples, row, time_s, signal, distance, status);
    follow_ambient(samples, ambient);
    const int packet = (int)(RL_PACKET_BITS * samples->bit_s / samples->period_s + 0.5);
    rl_noise_follow(samples, packet < samples->kept ? packet : samples->kept, full);
}

int rl_samples_oldest(const struct rl_samples *samples)
{
    return samples->count > samples->kept ? samples->count - samples->kept : 0;
}

int rl_samples_row(const struct rl_samples *samples, double time_s)
{
    int low = 0, high = samples->count;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (samples->end_s[middle] > time_s) {
            high = middle;
        } else {
            low = middle + 1;
        }
    }
    return low;
}
