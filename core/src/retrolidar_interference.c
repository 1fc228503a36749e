/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_interference.h"

#include "retrolidar_packet.h"

#include <math.h>

/* Packets keep time if they begin so near to where others would [bits]. */
static const double SAME_PHASE_BITS = 1.0;

bool rl_keeps_time(const struct rl_packet_train *before, const struct rl_packet_train *now)
{
    const double apart = (now->transmission.start_s - before->transmission.start_s) /
                         (RL_PACKET_BITS * now->transmission.bit_s);
    return fabs(apart - floor(apart + 0.5)) * RL_PACKET_BITS < SAME_PHASE_BITS;
}

static bool is_of_one_marker(const struct rl_packet_train *one, const struct rl_packet_train *other)
{
    const double overlap_s = fmin(one->end_s, other->end_s) - fmax(one->begin_s, other->begin_s);
    return overlap_s < SAME_PHASE_BITS * one->transmission.bit_s && rl_keeps_time(one, other);
}

int rl_interference_marker(const struct rl_interference *interference, int index)
{
    int first = 0;
    while (first < index && !is_of_one_marker(&interference->train[first],
                                              &interference->train[index])) {
        first++;
    }
    return first;
}

void rl_interference_light(const struct rl_interference *interference, int marker, bool continues,
                           const double *begin_s, const double *end_s, int rows, double *part,
                           double *light)
{
    int last = marker;
    for (int i = marker + 1; i < interference->count; i++) {
        if (rl_interference_marker(interference, i) == marker &&
            interference->train[i].end_s > interference->train[last].end_s) {
            last = i;
        }
    }
    for (int i = marker; i < interference->count; i++) {
        if (rl_interference_marker(interference, i) != marker) {
            continue;
        }
        rl_train_light(&interference->train[i], continues && i == last, begin_s, end_s,
                              rows, i == marker ? light : part);
        for (int row = 0; i != marker && row < rows; row++) {
            light[row] *= part[row];
        }
    }
}
