/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Frames in, packets out: reads the markers in all zones of a sensor. */
#ifndef RETROLIDAR_DETECTOR_H
#define RETROLIDAR_DETECTOR_H

#include <stdbool.h>
#include <stdint.h>

#include "retrolidar_bearing.h"
#include "retrolidar_decide.h"
#include "retrolidar_sensor.h"

/* binding */
enum { RL_MAX_READ = 16 };

struct rl_settings {
    struct rl_sensor sensor;
    int32_t max_packets; /* that may be combined, 1 to 8 */
    int32_t kept;        /* rows of samples that are held */
    double bit_s;        /* how long markers hold a bit [s] */
    struct rl_demands demands;
};

/* When and where a marker is. */
struct rl_placement {
    double range_m, range_variance; /* radial */
    double time_s;             /* when it holds: the mean time of the samples that it is made of */
    int64_t end_ns;            /* stamp of the last frame used */
    struct rl_bearing bearing; /* from the middle of the strongest zone */
    double amplitude, noise;   /* in that zone: by how much the signal rises with the light
                                * [kcps/SPAD], and the variance of what the packet leaves over */
    double score;              /* correlation of its samples with the light of the packet, 0 to 1 */
    double likelihood;         /* the paper's l of the first whole preamble */
    int32_t corrected_bits; /* of the last packet, which a receiver would take for the other ones */
    int32_t zones;
    int32_t zone[RL_MAX_READ]; /* that saw it, strongest first */
};

/* A packet that was read: as it was judged, but from when on samples are held, and with the start
 * of the packet that the window holds the most of.
 */
struct rl_reading {
    struct rl_verdict verdict;
    int32_t zones;
    int32_t zone[RL_MAX_READ]; /* strongest first */
    bool is_placed;            /* else no distance was measured */
    struct rl_placement placement;
};

/* What was read with the frame that was taken last, and what was judged, read or not. */
struct rl_newest {
    int64_t origin_ns; /* from which times count */
    int32_t readings, candidates;
    const struct rl_reading *reading;
    const struct rl_verdict *candidate;
};

struct rl_detector;

/* Memory is taken here and never after; NULL if there is none, or the settings cannot be. */
struct rl_detector *rl_detector_create(const struct rl_settings *settings, const uint16_t *ids,
                                       int32_t count);
void rl_detector_destroy(struct rl_detector *detector);

/* Take frames, one after the other, until candidates are judged with one of them; return how many
 * frames were taken. The arrays are of shape (frames) and (frames, zones). Frames that are repeated
 * or late are left out; after a jump back, or forward by more than a packet, it restarts.
 */
int32_t rl_detector_push(struct rl_detector *detector, int32_t frames, const int64_t *stamp_ns,
                         const float *signal, const float *distance, const float *ambient,
                         const uint8_t *status);

struct rl_newest rl_detector_newest(const struct rl_detector *detector);

/* Counters: candidates that were judged, rejected for each reason, and so on. */
struct rl_counts {
    uint64_t candidates, accepted, impossible, overloads;
    uint64_t rejected[5];
};
struct rl_counts rl_detector_counts(const struct rl_detector *detector);
/* end of binding */

#endif
