/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * Gives frames of garbage to detectors of any settings, and looks at all that they say.
 *
 * fuzz SEED DETECTORS FRAMES
 *
 * Of every detector it prints what came of it.
 */
#include "fuzz.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>

enum { BLOCK = 64 };

uint16_t ids[4096];
int id_count;

static struct rl_settings any_settings(void)
{
    const int rows = below(3) ? 4 : 8;
    return (struct rl_settings){
        .rows = rows,
        .columns = rows,
        .max_packets = 1 + below(8),
        .kept = KEPT,
        .bit_s = below(3) ? 0.042 : scaled(0.002, 10.0),
        .noise_floor = below(2) ? 4.6 : scaled(1e-12, 1e12),
        .noise_slope = below(2) ? 0.22 : below(4) ? scaled(1e-12, 1e12) : 0.0,
        .noise_ambient = below(2) ? 0.22 : below(4) ? scaled(1e-12, 1e12) : 0.0,
        /* Little is demanded, so that much is read. */
        .evidence = below(2) ? 28.0 : 40.0 * share(),
        .wandering = below(2) ? 6.0 : 0.0,
        .word = below(2) ? 8.0 : 1e3,
        .margin = below(2) ? 7.0 : -1e3,
        .margin_of_more = below(2) ? 9.0 : -1e3,
    };
}

static void register_ids(void)
{
    const int every = below(3) == 0 ? 1 + below(3) : 1 + below(4094);
    id_count = 0;
    for (int id = LEAST_ID + below(every); id <= MOST_ID && every < 4000; id += every) {
        ids[id_count++] = (uint16_t)id;
    }
}

static void try_one(int number, int frames)
{
    static int64_t stamp_ns[BLOCK];
    static float signal[BLOCK * ZONES], distance[BLOCK * ZONES], ambient[BLOCK * ZONES];
    static uint8_t status[BLOCK * ZONES];
    const struct rl_settings settings = any_settings();
    const int zones = settings.rows * settings.columns;
    /* Two frames a bit; or so many that a packet just about fits in what is kept; or any. */
    const double bits_a_frame = below(3)   ? 0.5
                                : below(3) ? (double)RL_PACKET_BITS / KEPT * (0.9 + 0.2 * share())
                                           : scaled(0.02, 2.0);
    const int64_t period_ns = 1 + (int64_t)(1e9 * settings.bit_s * bits_a_frame);
    const int garbage_share = below(3) ? 1 + below(100) : 10000;
    const int alike = below(2);
    struct zone zone[ZONES];
    int64_t stamp = below(2) ? 0 : (int64_t)any();
    double time_s = 0.0;
    int kind = any_stamp_kind(), read = 0, candidates = 0;
    register_ids();
    struct rl_detector *detector = rl_detector_create(&settings, ids, id_count);
    EXPECT(detector != NULL);
    isolate(detector);
    for (int i = 0; i < zones; i++) {
        zone[i] = i > 0 && alike && below(8) ? beside(&zone[0]) : any_zone(settings.bit_s);
    }
    for (int done = 0; done < frames;) {
        const int block = 1 + below(BLOCK);
        for (int frame = 0; frame < block; frame++) {
            const int64_t before = stamp;
            stamp = next_stamp(stamp, kind, period_ns);
            if (stamp > before && (uint64_t)stamp - (uint64_t)before < 1u << 31) {
                time_s += (double)(stamp - before) * 1e-9;
            }
            stamp_ns[frame] = stamp;
            for (int i = 0; i < zones; i++) {
                const int at = frame * zones + i;
                const int strange = zone[i].kind == GARBAGE || below(garbage_share) == 0;
                signal[at] = strange ? garbage() : light(&zone[i], time_s);
                distance[at] =
                    strange ? garbage() : (float)(zone[i].distance * (1.0 + 0.1 * share()));
                ambient[at] = strange ? garbage() : 1.0f;
                status[at] = strange ? any_status() : 5;
            }
        }
        for (int taken = 0; taken < block;) {
            const int at = taken * zones;
            const int more =
                rl_detector_push(detector, block - taken, stamp_ns + taken, signal + at,
                                 distance + at, ambient + at, status + at);
            EXPECT(more > 0 && more <= block - taken);
            taken += more;
            read += rl_detector_readings(detector);
            candidates += rl_detector_candidates(detector);
            ask(detector);
        }
        check(detector, &settings);
        done += block;
        if (below(10) == 0) {
            kind = any_stamp_kind();
            zone[below(zones)] = any_zone(settings.bit_s);
        }
    }
    printf("%d: %d zones, %d IDs, bits of %g s: %d candidates, %d read\n", number, zones, id_count,
           settings.bit_s, candidates, read);
    rl_detector_destroy(detector);
    give_back();
}

int main(int count, char **words)
{
    EXPECT(count == 4);
    const int first = atoi(words[1]), detectors = atoi(words[2]), frames = atoi(words[3]);
    for (int number = first; number < first + detectors; number++) {
        state = 0x9E3779B97F4A7C15u * (uint64_t)(number + 1);
        try_one(number, frames);
    }
    return 0;
}
