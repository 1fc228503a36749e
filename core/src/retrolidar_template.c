/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_template.h"

#include "retrolidar_packet.h"

#include <math.h>

/* From 10 to 90 % an exponential takes ln 9 time constants (paper 2.2: 0.5 ms and 3.5 ms). */
static const double LN_9 = 2.1972245773362196;
static const double DARKENING_S = 0.0005;

struct packet {
    /* Of each bit, and of the idle after them: what it goes to, comes from, and when it begins, as
     * the integral since the start of the packet [s].
     */
    double level[RL_PACKET_BITS + 1], before[RL_PACKET_BITS + 1], elapsed[RL_PACKET_BITS + 1];
};

/* The integral of an exponential step over a time since it began [s]. */
static double relaxed(double before, double level, double brightening_s, double since_s)
{
    const double step = before - level;
    if (step == 0.0) {
        return level * since_s;
    }
    const double tau = (step > 0.0 ? DARKENING_S : brightening_s) / LN_9;
    return level * since_s + step * tau * (since_s > 20.0 * tau ? 1.0 : 1.0 - exp(-since_s / tau));
}

static void lay_out(const struct rl_sending *sending, struct packet *packet)
{
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        packet->level[bit] = sending->bits & rl_packet_bit(bit) ? 0.0 : 1.0;
    }
    packet->level[RL_PACKET_BITS] = 1.0;
    packet->before[0] = sending->repeats ? packet->level[RL_PACKET_BITS - 1] : 1.0;
    packet->elapsed[0] = 0.0;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        packet->before[bit + 1] = packet->level[bit];
        packet->elapsed[bit + 1] =
            packet->elapsed[bit] + relaxed(packet->before[bit], packet->level[bit],
                                           sending->brightening_s, sending->bit_s);
    }
}

/* The integral of the transmission from the start of the packet to a time since then [s]. */
static double integral(const struct rl_sending *sending, const struct packet *packet,
                       double since_s)
{
    double sent = 0.0;
    if (sending->repeats) {
        const double length_s = RL_PACKET_BITS * sending->bit_s;
        const double cycles = floor(since_s / length_s);
        since_s -= cycles * length_s;
        sent = cycles * packet->elapsed[RL_PACKET_BITS];
    } else if (since_s <= 0.0) {
        return since_s;
    }
    const int last = RL_PACKET_BITS - (sending->repeats ? 1 : 0);
    const int at = (int)(since_s / sending->bit_s);
    const int bit = at < last ? at : last;
    return sent + packet->elapsed[bit] +
           relaxed(packet->before[bit], packet->level[bit], sending->brightening_s,
                   fmax(since_s - bit * sending->bit_s, 0.0));
}

void rl_template(const struct rl_sending *sending, const double *begin_s, const double *end_s,
                 int rows, double *light)
{
    struct packet packet;
    lay_out(sending, &packet);
    double until = 0.0, until_s = -INFINITY;
    for (int row = 0; row < rows; row++) {
        const double from = begin_s[row] == until_s
                                ? until
                                : integral(sending, &packet, begin_s[row] - sending->start_s);
        until_s = end_s[row];
        until = integral(sending, &packet, until_s - sending->start_s);
        light[row] = (until - from) / (end_s[row] - begin_s[row]);
    }
}
