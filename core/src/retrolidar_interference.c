/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_interference.h"

#include "retrolidar_packet.h"

#include <math.h>

/* Two packets are of one marker if the later one begins so near to where the next one would [bits]. */
static const double SAME_PHASE_BITS = 1.0;

static bool is_of_one_marker(const struct rl_packet_train *one, const struct rl_packet_train *other)
{
    const double bit_s = one->transmission.bit_s;
    const double apart = (other->transmission.start_s - one->transmission.start_s) / (RL_PACKET_BITS * bit_s);
    const double overlap_s = fmin(one->end_s, other->end_s) - fmax(one->begin_s, other->begin_s);
    return fabs(apart - floor(apart + 0.5)) * RL_PACKET_BITS < SAME_PHASE_BITS &&
           overlap_s < SAME_PHASE_BITS * bit_s;
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

void rl_interference_light(const struct rl_interference *interference, int marker, bool goes_on,
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
        rl_train_light(&interference->train[i], goes_on && i == last, begin_s, end_s,
                              rows, i == marker ? light : part);
        for (int row = 0; i != marker && row < rows; row++) {
            light[row] *= part[row];
        }
    }
}
