/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets that are expected where another one of a marker ends or begins. As start and clock are
 * known, they are searched at these only.
 */
#include "retrolidar_detector_state.h"

#include <math.h>

/* Search a zone for a packet of any ID at an expected time, less those that were read before, and
 * judge it. As no start is chosen among many, it needs less evidence.
 */
static void judge_any(struct rl_detector *detector, int zone,
                      const struct rl_packet_train *expected)
{
    const double bit_s = expected->transmission.bit_s, end_s = expected->end_s;
    const double phase_s = bit_s / RL_PHASES;
    struct rl_pending pending = {.channel = zone, .packets = 1, .since_s = -INFINITY};
    rl_residual_subtract(detector, zone, expected->begin_s,
                         expected->begin_s - RL_SILENT_BITS * bit_s, NULL);
    const struct rl_sought sought = {.from_s = end_s - phase_s,
                                     .to_s = fmin(end_s + phase_s, detector->newest_s),
                                     .since_s = -INFINITY,
                                     .least = detector->min_nats - RL_COST_OF_CHANCE,
                                     .max_llr_deficit = detector->max_llr_deficit};
    rl_search_channels(&detector->search, &sought, &zone, 1, &pending.hits);
    rl_residual_restore(detector, zone);
    for (int i = 0; i < pending.hits.count; i++) {
        struct rl_transmission *found = &pending.hits.hit[i].transmission;
        found->start_s = expected->transmission.start_s;
        found->bit_s = bit_s;
    }
    if (pending.hits.count > 0) {
        rl_judge(detector, &pending);
    }
}

void rl_judge_expected(struct rl_detector *detector, double from_s)
{
    const struct rl_pool *pool = &detector->pool;
    const struct rl_samples *samples = &detector->samples;
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    for (int i = 0; i < pool->count; i++) {
        const struct rl_active_track track = pool->track[i];
        struct rl_transmission packet = track.train.transmission;
        const double packet_s = RL_PACKET_BITS * packet.bit_s;
        packet.dark_before = packet.dark_after = false;
        for (int later = -1; later <= 1 && !packet.repeats; later += 2) {
            packet.start_s = track.train.transmission.start_s + later * packet_s;
            const struct rl_packet_train expected = {packet, packet.start_s,
                                                     packet.start_s + packet_s};
            /* Once it has ended, and after others that overlap it may have been read. */
            for (int tried = 0; tried < RL_TRIED; tried++) {
                const double at_s =
                    expected.end_s + tried * (packet_s + RL_LOOK_BITS * packet.bit_s);
                if (at_s > from_s && at_s <= detector->newest_s && packet.start_s >= held_s &&
                    detector->decisions_left > 0 &&
                    !rl_pool_has(pool, track.zones, &expected)) {
                    judge_any(detector, track.zone, &expected);
                }
            }
        }
    }
}
