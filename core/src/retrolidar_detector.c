/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_detector.h"

#include "retrolidar_constants.h"
#include "retrolidar_process_frame.h"

#include <math.h>
#include <stdlib.h>

static int64_t aligned(int64_t bytes)
{
    return (bytes + 15) / 16 * 16;
}

struct rl_detector *rl_detector_create(const struct rl_settings *settings, const uint16_t *ids,
                                       int32_t count)
{
    const struct rl_sensor *sensor = &settings->sensor;
    const int rows = settings->kept;
    const int64_t head = aligned((int64_t)sizeof(struct rl_detector));
    const int64_t samples = aligned(rl_samples_bytes(sensor->rows, sensor->columns, rows));
    const int channels = rl_channels(sensor->rows, sensor->columns);
    const int64_t search = aligned(rl_search_bytes(channels, rows));
    const int64_t window = aligned(rl_window_bytes(rows));
    const int64_t residual = aligned(rl_residual_bytes(channels, rows));
    const int64_t values = rows * (int64_t)(sizeof(float) + 1);
    char *memory = calloc(1, (size_t)(head + samples + search + window + residual + values));
    if (memory == NULL) {
        return NULL;
    }
    struct rl_detector *detector = (struct rl_detector *)memory;
    detector->settings = *settings;
    detector->demands = (struct rl_demands){
        .evidence = settings->evidence,
        .wandering = settings->wandering,
        .word = settings->word,
        .margin = settings->margin,
        .bit_s = settings->bit_s,
        .max_skew = RL_MAX_SKEW,
    };
    /* On coarse templates others may be better by some more. */
    detector->max_llr_deficit = RL_COST_OF_CHANCE + settings->word;
    memory += head;
    rl_samples_start(&detector->samples, sensor, rows, memory, settings->bit_s);
    memory += samples;
    rl_codebook_start(&detector->search.codebook, ids, count);
    rl_search_start(&detector->search, &detector->samples, settings->bit_s, RL_MAX_SKEW, memory);
    memory += search;
    rl_window_start(&detector->window, &detector->samples, rows, memory);
    memory += window;
    rl_residual_start(&detector->residual, &detector->samples, rows, memory);
    memory += residual;
    detector->values = (float *)memory;
    detector->role = (uint8_t *)(detector->values + rows);
    rl_bearing_start(&detector->bearing);
    return detector;
}

void rl_detector_destroy(struct rl_detector *detector)
{
    free(detector);
}

/* Forget all that came before. */
static void restart(struct rl_detector *detector, int64_t stamp_ns)
{
    rl_samples_clear(&detector->samples, stamp_ns);
    detector->pool.added = 0;
    detector->looked_s = -INFINITY;
    detector->slot = 0;
    detector->search.frames_a_bit = 0.0;
    for (int zone = 0; zone < RL_MAX_ZONES; zone++) {
        detector->active_s[zone] = -INFINITY;
        detector->is_read_anew[zone] = false;
    }
    for (int channel = 0; channel < RL_MAX_CHANNELS; channel++) {
        detector->consumed_until_s[channel] = -INFINITY;
    }
}

int32_t rl_detector_push(struct rl_detector *detector, int32_t frames, const int64_t *stamp_ns,
                         const float *signal, const float *distance, const float *ambient,
                         const uint8_t *status)
{
    const size_t zones = (size_t)detector->samples.zones;
    const int64_t longest_ns = (int64_t)(RL_PACKET_BITS * detector->settings.bit_s * 1e9);
    detector->readings = detector->candidates = 0;
    for (int32_t frame = 0; frame < frames; frame++) {
        const int64_t stamp = stamp_ns[frame];
        if (detector->samples.count > 0 && stamp == detector->last_ns) {
            continue;
        }
        if (detector->samples.count == 0 || stamp < detector->last_ns ||
            (uint64_t)stamp - (uint64_t)detector->last_ns > (uint64_t)longest_ns) {
            restart(detector, stamp);
        }
        detector->last_ns = stamp;
        const size_t at = (size_t)frame * zones;
        rl_samples_push(&detector->samples, stamp, signal + at, distance + at, ambient + at,
                        status + at);
        rl_process_frame(detector);
        if (detector->candidates > 0) {
            return frame + 1;
        }
    }
    return frames;
}

int32_t rl_detector_readings(const struct rl_detector *detector)
{
    return detector->readings;
}

struct rl_reading rl_detector_reading(const struct rl_detector *detector, int32_t index)
{
    return detector->reading[index];
}

int32_t rl_detector_candidates(const struct rl_detector *detector)
{
    return detector->candidates;
}

struct rl_candidate rl_detector_candidate(const struct rl_detector *detector, int32_t index)
{
    return detector->candidate[index];
}

struct rl_held rl_detector_held(const struct rl_detector *detector)
{
    const struct rl_samples *samples = &detector->samples;
    return (struct rl_held){
        .first = rl_samples_oldest(samples),
        .count = samples->count,
        .capacity = samples->capacity,
        .channels = samples->channels,
        .zones = samples->zones,
        .origin_ns = samples->origin_ns,
        .period_s = samples->period_s,
        .begin_s = samples->begin_s,
        .end_s = samples->end_s,
        .stamp_ns = samples->stamp_ns,
        .signal = samples->signal,
        .valid = samples->valid,
        .distance = samples->distance,
    };
}

struct rl_counts rl_detector_counts(const struct rl_detector *detector)
{
    struct rl_counts counts = detector->counts;
    counts.impossible = detector->samples.impossible;
    return counts;
}
