/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_going_on.h"

#include "retrolidar_noise.h"

#include <math.h>

/* A source varies by so much less without a packet that is sent. */
static const double LESS = 0.9;
/* Readings of one marker follow each other if they are so near. */
static const double FOLLOWING_BITS = 2.0 * RL_PACKET_BITS;

void rl_going_on_add(struct rl_going_on going_on[RL_GOING_ON], const struct rl_verdict *read,
                     double gain)
{
    int at = 0;
    double begin_s = rl_verdict_begin(read);
    while (at < RL_GOING_ON - 1 && going_on[at].id != read->id) {
        at++;
    }
    if (going_on[at].id == read->id &&
        begin_s < going_on[at].end_s + FOLLOWING_BITS * read->sending.bit_s) {
        begin_s = going_on[at].begin_s;
    }
    for (; at > 0; at--) {
        going_on[at] = going_on[at - 1];
    }
    going_on[0] = (struct rl_going_on){read->id, read->sending, gain, begin_s, read->end_s};
    going_on[0].sending.repeats = true;
}

struct rl_hit rl_going_on_hit(const struct rl_going_on *going_on)
{
    return (struct rl_hit){0.0f, going_on->id, true, going_on->sending.start_s,
                           going_on->sending.bit_s};
}

/* How a source has varied since a time, over what is noise. */
static double variation(const struct rl_samples *samples, int source, double since_s)
{
    const int first = rl_samples_row(samples, since_s), rows = samples->count - first;
    const float *signals = samples->signal + rl_sample(samples, source, first);
    double sum = 0.0, square = 0.0;
    for (int row = 0; row < rows; row++) {
        const double signal = signals[row];
        sum += signal;
        square += signal * signal;
    }
    if (rows < 2) {
        return 0.0;
    }
    const double mean = sum / rows;
    return (square - sum * mean) / (rows - 1) /
           (samples->noise_scale * rl_noise_variance(samples, source, mean));
}

bool rl_going_on_is_sent(const struct rl_going_on *going_on, struct rl_shares *shares, int source,
                         double to_s, struct rl_verdict *known, double *rest)
{
    const double packet_s = RL_PACKET_BITS * going_on->sending.bit_s, since_s = to_s - packet_s;
    *known = (struct rl_verdict){
        .reason = RL_READ,
        .id = going_on->id,
        /* Of more packets, to see whether another one has repeated. */
        .packets = to_s - going_on->begin_s < 2.0 * packet_s ? 1 : 2,
        .sending = going_on->sending,
        .end_s = to_s,
        .sources = 1,
        .source = {source},
        .fit = {{.gain = going_on->gain}},
        .steady = true,
    };
    const double all = variation(shares->samples, source, since_s);
    rl_shares_take_off(shares, known, false);
    *rest = variation(shares->samples, source, since_s);
    rl_shares_take_off(shares, known, true);
    return *rest < LESS * all;
}
