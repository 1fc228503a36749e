/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The newest samples of all zones, placed by their times, and of sums of zones. */
#ifndef RETROLIDAR_SAMPLES_H
#define RETROLIDAR_SAMPLES_H

#include "retrolidar_math.h"
#include "retrolidar_sensor.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

enum {
    RL_MAX_SIDE = 4,       /* of a square of summed zones: the whole view of a 4x4 sensor */
    RL_MAX_CHANNELS = 174, /* all squares of 8x8 zones */
};

/* The stamp of a row without a frame; 0 is a valid stamp. */
#define RL_NO_FRAME INT64_MIN

/* A signal that is searched for packets: a zone, or a sum of zones that a marker may cross. */
struct rl_channel {
    int zones;     /* in the sum */
    uint64_t mask; /* a bit for each of these */
    uint8_t zone[RL_MAX_SIDE * RL_MAX_SIDE];
};

/* A row is a frame period; a lost frame is a row of erasures. Arrays over rows and channels hold
 * one channel after the other, `capacity` rows of each.
 */
struct rl_samples {
    struct rl_sensor sensor;
    int zones;
    int channels;
    struct rl_channel channel[RL_MAX_CHANNELS];
    int kept;                /* newest rows that are always held */
    int capacity;            /* rows that there is memory for */
    int count;               /* rows that are held */
    int64_t origin_ns;       /* stamp at time 0 */
    double bit_s;            /* as expected [s] */
    double period_s;         /* of the frames, as measured; half a bit until then [s] */
    int64_t *stamp_ns;       /* of each frame; RL_NO_FRAME = none came */
    double *begin_s, *end_s; /* of each exposure [s] */
    float *signal;           /* [kcps/SPAD]; of an erasure, the last one before it */
    uint8_t *valid;          /* 0 = erasure */
    float *distance;         /* of zones only, NaN where none was measured [m] */
    bool interference_removed[RL_MAX_CHANNELS]; /* packets are subtracted: it has one target */
    int variance_rows; /* newest rows in the sums below */
    double *sum, *square;
    double ambient;      /* median of the newest frame [kcps/SPAD] */
    uint64_t impossible; /* samples of a valid status that the sensor cannot measure */
    double last_seen_s[RL_MAX_ZONES];
    float last_signal[RL_MAX_ZONES];
    float step_s[15]; /* the newest times from frame to frame */
    uint32_t steps;
};

/* Where in the arrays a row of a channel is. */
static inline size_t rl_sample(const struct rl_samples *samples, int channel, int row)
{
    return (size_t)channel * (size_t)samples->capacity + (size_t)row;
}

/* Whether a zone is the same as another one or beside it. */
static inline bool rl_zone_beside(int zone, int other, int columns)
{
    return abs(zone / columns - other / columns) <= 1 && abs(zone % columns - other % columns) <= 1;
}

/* Take the arrays. */
void rl_samples_start(struct rl_samples *samples, const struct rl_sensor *sensor, int kept,
                      double bit_s, struct rl_memory *memory);

/* Begin, or forget all: times count from this stamp now. */
void rl_samples_clear(struct rl_samples *samples, int64_t stamp_ns);

/* Append a frame that is later than all before, and erasures for those that were lost. */
void rl_samples_push(struct rl_samples *samples, int64_t stamp_ns, const float *signal,
                     const float *distance, const float *ambient, const uint8_t *status);

/* Number of the first row that is always held. */
int rl_samples_oldest(const struct rl_samples *samples);

/* Number of the first row whose exposure ends after a time. */
int rl_samples_row(const struct rl_samples *samples, double time_s);

/* Variance of a channel's noise at a signal, by the sensor's law [(kcps/SPAD)^2]. */
double rl_noise_variance(const struct rl_samples *samples, int channel, double signal);

/* After a row was appended: update the sums to the newest rows, as many as `wanted`, or anew. */
void rl_noise_follow(struct rl_samples *samples, int wanted, bool recompute);

/* Variance of a channel over the newest `variance_rows`, over the variance of its noise. */
double rl_noise_variation(const struct rl_samples *samples, int channel);

#endif
