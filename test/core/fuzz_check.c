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
    static double light_of[4 * KEPT];
    static float signal[4 * KEPT * ZONES];
    static uint8_t valid[4 * KEPT * ZONES];
    const struct rl_held held = rl_detector_held(detector);
    for (int i = 0; i < rl_detector_readings(detector); i++) {
        const struct rl_reading one = rl_detector_reading(detector, i);
        int first = 0, last = 0;
        while (first < held.count && held.end_s[first] <= one.begin_s) {
            first++;
        }
        while (last < held.count && held.begin_s[last] < one.end_s) {
            last++;
        }
        EXPECT(first < last);
        rl_detector_light(detector, &one, first, last - first, light_of);
        rl_detector_columns(detector, first, last - first, signal, valid);
        for (int row = 0; row < last - first; row++) {
            EXPECT(light_of[row] > -1e-6 && light_of[row] < 1.0 + 1e-6);
            for (int zone = 0; zone < held.zones; zone++) {
                EXPECT(isfinite(signal[row * held.zones + zone]));
            }
        }
    }
}
