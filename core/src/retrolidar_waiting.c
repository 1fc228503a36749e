/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_waiting.h"

/* Evidence over that in demand with which a packet stands out before it has ended. */
static const float STRONG = 2.0f;

void rl_waiting_note(struct rl_detector *detector, int source, const struct rl_verdict *verdict,
                     double to_s)
{
    const struct rl_sending *sending = &verdict->sending;
    struct rl_hit *waiting = &detector->waiting[source];
    const float nats = (float)verdict->evidence;
    const bool is_over =
        to_s > waiting->start_s + (RL_PACKET_BITS + RL_LATER_BITS) * waiting->bit_s;
    const float strong = verdict->end_s > to_s ? STRONG : 1.0f;
    if (verdict->reason == RL_INCOMPLETE && !sending->repeats &&
        nats > strong * (float)detector->demands.evidence && (is_over || nats >= waiting->nats)) {
        *waiting = (struct rl_hit){nats, verdict->id, false, sending->start_s, sending->bit_s};
    }
}

void rl_waiting_add(struct rl_detector *detector, double from_s, double to_s)
{
    for (int source = 0; source < detector->samples.sources; source++) {
        const struct rl_hit *waiting = &detector->waiting[source];
        const double end_s = waiting->start_s + RL_PACKET_BITS * waiting->bit_s;
        const double later_s = end_s + RL_LATER_BITS * waiting->bit_s;
        if (waiting->id != 0 &&
            ((end_s > from_s && end_s <= to_s) || (later_s > from_s && later_s <= to_s))) {
            detector->pending[detector->pendings++] =
                (struct rl_pending){source, 1, {.hit = {*waiting}, .count = 1}};
        }
    }
}
