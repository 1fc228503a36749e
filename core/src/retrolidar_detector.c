/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_detector_state.h"

#include <math.h>
#include <stdlib.h>

/* Take all arrays. */
static void start(struct rl_detector *detector, struct rl_memory *memory)
{
    const struct rl_settings *settings = &detector->settings;
    const int64_t rows = settings->kept;
    struct rl_samples *samples = &detector->samples;
    rl_samples_start(samples, &settings->sensor, settings->kept, settings->bit_s, memory);
    rl_search_start(&detector->search, samples, memory);
    rl_window_start(&detector->window, samples, memory);
    for (int i = 0; i < RL_SUMMED - 1; i++) {
        rl_window_start(&detector->other_zone[i], samples, memory);
    }
    detector->window.other = detector->other_zone;
    detector->saved = rl_take(memory, samples->channels * rows, sizeof *detector->saved);
    detector->other = rl_take(memory, RL_MAX_OTHERS * rows, sizeof *detector->other);
    detector->values = rl_take(memory, rows, sizeof *detector->values);
    detector->role = rl_take(memory, rows, 1);
}

/* Forget all that came before. */
static void restart(struct rl_detector *detector, int64_t stamp_ns)
{
    rl_samples_clear(&detector->samples, stamp_ns);
    detector->pool.count = 0;
    detector->newest_s = -INFINITY;
    detector->read_anew = 0;
    detector->read_from_s = INFINITY;
    detector->search.frames_a_bit = 0.0;
    for (int zone = 0; zone < RL_MAX_ZONES; zone++) {
        detector->active_s[zone] = -INFINITY;
    }
    for (int channel = 0; channel < RL_MAX_CHANNELS; channel++) {
        detector->read_until_s[channel] = -INFINITY;
    }
}

struct rl_detector *rl_detector_create(const struct rl_settings *settings, const uint16_t *ids,
                                       int32_t count)
{
    struct rl_memory memory = {NULL, 0};
    struct rl_detector *detector = calloc(1, sizeof *detector);
    if (detector == NULL) {
        return NULL;
    }
    detector->settings = *settings;
    start(detector, &memory);
    memory.block = calloc(1, (size_t)memory.taken);
    if (memory.block == NULL) {
        free(detector);
        return NULL;
    }
    memory.taken = 0;
    start(detector, &memory);
    detector->memory = memory.block;
    detector->min_nats = RL_MOST * settings->thresholds.evidence;
    /* On coarse templates others may be better by some more. */
    detector->max_llr_deficit = RL_COST_OF_CHANCE + settings->thresholds.word;
    rl_codebook_start(&detector->search.codebook, ids, count);
    rl_bearing_start(&detector->bearing);
    restart(detector, 0);
    return detector;
}

void rl_detector_destroy(struct rl_detector *detector)
{
    if (detector != NULL) {
        free(detector->memory);
        free(detector);
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
        /* One that is repeated, or was overtaken: time that is set back goes back by more. */
        if (detector->samples.count > 0 && stamp <= detector->last_ns &&
            (uint64_t)detector->last_ns - (uint64_t)stamp <= RL_MAX_LATE_NS) {
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
        for (int i = 0; i < detector->readings; i++) {
            struct rl_reading *reading = &detector->reading[i];
            reading->is_placed = rl_place(detector, reading, &reading->placement);
        }
        if (detector->candidates > 0) {
            return frame + 1;
        }
    }
    return frames;
}

struct rl_newest rl_detector_newest(const struct rl_detector *detector)
{
    return (struct rl_newest){detector->samples.origin_ns, detector->readings,
                              detector->candidates, detector->reading, detector->candidate};
}

struct rl_counts rl_detector_counts(const struct rl_detector *detector)
{
    struct rl_counts counts = detector->counts;
    counts.impossible = detector->samples.impossible;
    return counts;
}
