/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * What must hold of a detector, whatever it is given.
 */
#include "fuzz.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

void expect(int holds, const char *what)
{
    if (!holds) {
        fflush(stdout);
        fprintf(stderr, "not so: %s\n", what);
        exit(1);
    }
}

void check(const struct rl_detector *detector, const struct rl_settings *settings)
{
    const int zones = settings->rows * settings->columns;
    const int sources = zones + (settings->rows - 1) * (settings->columns - 1) + 1;
    const struct rl_counts counts = rl_detector_counts(detector);
    const struct rl_held held = rl_detector_held(detector);
    uint64_t refused = 0;
    for (int reason = 0; reason < RL_REASONS; reason++) {
        refused += counts.refused[reason];
    }
    EXPECT(counts.accepted + refused == counts.candidates);
    EXPECT(held.zones == zones && held.sources == sources);
    EXPECT(held.first >= 0 && held.first <= held.count && held.count <= 4 * KEPT);
    EXPECT(held.noise_scale >= 1.0 / 16 && held.noise_scale <= 16.0);
    EXPECT(held.period_s > 0.0 && isfinite(held.period_s));
    for (int row = held.first; row < held.count; row++) {
        EXPECT(isfinite(held.begin_s[row]) && held.begin_s[row] < held.end_s[row]);
        EXPECT(row == held.first || held.end_s[row - 1] <= held.begin_s[row]);
        for (int source = 0; source < sources; source++) {
            EXPECT(isfinite(held.signal[(size_t)source * (size_t)held.capacity + (size_t)row]));
            EXPECT(held.signal[(size_t)source * (size_t)held.capacity + (size_t)row] >= 0.0f);
        }
        for (int zone = 0; zone < zones; zone++) {
            const float distance = held.distance[(size_t)zone * (size_t)held.capacity + (size_t)row];
            EXPECT(isnan(distance) || (distance > 0.0f && distance < 8.192f));
        }
    }
    for (int i = 0; i < rl_detector_candidates(detector); i++) {
        const struct rl_candidate one = rl_detector_candidate(detector, i);
        EXPECT(one.reason >= 0 && one.reason <= RL_REASONS);
        EXPECT(one.source >= 0 && one.source < sources);
        EXPECT(one.packets >= 1 && one.packets <= settings->max_packets);
        EXPECT(isfinite(one.start_s) && isfinite(one.bit_s));
        EXPECT(fabs(one.bit_s / settings->bit_s - 1.0) < 0.05);
        EXPECT(isfinite(one.evidence) && isfinite(one.margin));
        EXPECT(isfinite(one.word) || one.word == -INFINITY);
    }
    for (int i = 0; i < rl_detector_readings(detector); i++) {
        const struct rl_reading one = rl_detector_reading(detector, i);
        int known = id_count == 0;
        for (int j = 0; j < id_count; j++) {
            known |= ids[j] == one.id;
        }
        EXPECT(known && one.id >= LEAST_ID && one.id <= MOST_ID);
        EXPECT(one.packets >= 1 && one.packets <= settings->max_packets);
        EXPECT(isfinite(one.start_s) && fabs(one.bit_s / settings->bit_s - 1.0) < 0.05);
        EXPECT(one.brightening_s > 0.0 && one.brightening_s < 0.03);
        EXPECT(isfinite(one.begin_s) && isfinite(one.end_s) && one.begin_s < one.end_s);
        EXPECT(one.evidence >= settings->evidence && isfinite(one.evidence));
        EXPECT(isfinite(one.margin));
        EXPECT(one.zones >= 1 && one.zones <= 16);
        for (int j = 0; j < one.zones; j++) {
            EXPECT(one.zone[j] >= 0 && one.zone[j] < zones);
        }
    }
}

void ask(struct rl_detector *detector)
{
    double z_per_range[ZONES];
    const struct rl_optics optics = {z_per_range, 0.01, 0.0, 0.15};
    struct rl_placement placed;
    for (int zone = 0; zone < ZONES; zone++) {
        z_per_range[zone] = 0.95;
    }
    for (int i = 0; i < rl_detector_readings(detector); i++) {
        const struct rl_reading one = rl_detector_reading(detector, i);
        if (!rl_place(detector, &one, &optics, &placed)) {
            continue;
        }
        EXPECT(placed.range_m > 0.0 && placed.range_m < 20.0 && placed.range_variance > 0.0);
        EXPECT(isfinite(placed.range_variance) && isfinite(placed.amplitude));
        EXPECT(placed.time_s > one.begin_s - 1.0 && placed.time_s < one.end_s + 1.0);
        EXPECT(placed.noise > 0.0 && placed.likelihood >= 0.0);
        EXPECT(placed.score >= 0.0 && placed.score < 1.0 + 1e-9);
        EXPECT(placed.corrected_bits >= 0 && placed.corrected_bits <= RL_PACKET_BITS);
        EXPECT(placed.zones >= 1 && placed.zones <= one.zones);
        for (int axis = 0; axis < 2; axis++) {
            EXPECT(fabs(placed.bearing.mean[axis]) < 0.7 + 1e-9);
            EXPECT(placed.bearing.variance[axis] >= 0.0 && placed.bearing.variance[axis] < 0.49);
        }
    }
}
