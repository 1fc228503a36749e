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
    int32_t max_packets; /* to be combined, 1 to 8 */
    int32_t kept;        /* newest rows of samples that are held */
    double bit_s;        /* how long markers hold a bit [s] */
    struct rl_thresholds thresholds;
};

/* When and where a marker is. */
struct rl_placement {
    double range_m, range_variance; /* radial */
    double time_s;             /* mean time of the samples used */
    int64_t end_ns;            /* stamp of the last frame used */
    struct rl_bearing bearing; /* from the middle of the strongest zone */
    double amplitude, noise;   /* in that zone: gain of the light [kcps/SPAD], and variance of the
                                * residual */
    double score;              /* correlation of its samples with the light of the packet, 0 to 1 */
    double likelihood;         /* the paper's l of the first whole preamble */
    int32_t corrected_bits; /* of the last packet: those whose mean is on the wrong side */
    int32_t zones;
    int32_t zone[RL_MAX_READ]; /* that saw it, strongest first */
};

/* A packet that was read. The verdict begins where samples are held, and its start is that of the
 * packet of which the window holds most.
 */
struct rl_reading {
    struct rl_verdict verdict;
    int32_t zones;
    int32_t zone[RL_MAX_READ]; /* strongest first */
    bool is_placed;            /* else no distance was measured */
    struct rl_placement placement;
};

/* Readings of the newest frame, and all candidates that were judged with it. */
struct rl_newest {
    int64_t origin_ns; /* from which times count */
    int32_t readings, candidates;
    const struct rl_reading *reading;
    const struct rl_verdict *candidate;
};

struct rl_detector;

/* All memory is allocated here; NULL if there is none. The settings are not checked. */
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
