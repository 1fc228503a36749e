/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* When and where the marker of a reading is, from what all zones saw of it. */
#ifndef RETROLIDAR_PLACEMENT_H
#define RETROLIDAR_PLACEMENT_H

#include "retrolidar_bearing.h"
#include "retrolidar_detector.h"
#include "retrolidar_ranging.h"

/* binding */
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

/* Place a reading of the frame that was taken last, of a marker of a size; false where no distance
 * was measured. Every zone that has read it gives its range, and all zones around the strongest its
 * bearing.
 */
bool rl_place(struct rl_detector *detector, const struct rl_reading *reading, double size_m,
              struct rl_placement *placement);
/* end of binding */

#endif
