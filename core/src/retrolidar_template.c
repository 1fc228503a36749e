/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_template.h"

#include "retrolidar_packet.h"

#include <math.h>

/* From 10 to 90 % an exponential takes ln 9 time constants (paper 2.2: 0.5 ms and 3.5 ms). */
static const double LN_9 = 2.1972245773362196;
static const double DARKENING_S = 0.0005, BRIGHTENING_S = 0.0035;
/* Trains have the same phase if it differs by less [bits]. */
static const double SAME_PHASE_BITS = 1.0;
/* What was read begins with a packet if it begins by this share of one earlier. */
static const double WHOLE = 1.0 / RL_PACKET_BITS;

/* The levels before the packet, of each bit, and after them; and the integral of the light from the
 * start of the packet to the begin of each bit, and of what follows [s].
 */
struct packet {
    double level[RL_PACKET_BITS + 2], elapsed[RL_PACKET_BITS + 1];
};

/* The integral of an exponential step over a time since it began [s]. */
static double relaxed(double before, double level, double since_s)
{
    const double step = before - level;
    if (step == 0.0) {
        return level * since_s;
    }
    const double tau = (step > 0.0 ? DARKENING_S : BRIGHTENING_S) / LN_9;
    return level * since_s + step * tau * (since_s > 20.0 * tau ? 1.0 : 1.0 - exp(-since_s / tau));
}

static void lay_out(const struct rl_transmission *transmission, struct packet *packet)
{
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        packet->level[bit + 1] = transmission->bits & rl_packet_bit(bit) ? 0.0 : 1.0;
    }
    packet->level[RL_PACKET_BITS + 1] = transmission->dark_after ? 0.0 : 1.0;
    packet->level[0] = transmission->repeats ? packet->level[RL_PACKET_BITS]
                                             : (transmission->dark_before ? 0.0 : 1.0);
    packet->elapsed[0] = 0.0;
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        packet->elapsed[bit + 1] =
            packet->elapsed[bit] +
            relaxed(packet->level[bit], packet->level[bit + 1], transmission->bit_s);
    }
}

/* A position in a train. */
struct place {
    int bit;
    double bit_s; /* when the bit begins, since the start of the packet */
    double sent;  /* the integral of the packets before that one [s] */
};

static struct place place_of(const struct rl_transmission *transmission,
                             const struct packet *packet, double since_s)
{
    double cycles = 0.0;
    int bit = since_s > 0.0 ? (int)fmin(since_s / transmission->bit_s, RL_PACKET_BITS) : 0;
    if (transmission->repeats) {
        const double length_s = RL_PACKET_BITS * transmission->bit_s;
        cycles = floor(since_s / length_s);
        bit = (int)((since_s - cycles * length_s) / transmission->bit_s);
        bit = bit < RL_PACKET_BITS ? bit : RL_PACKET_BITS - 1;
    }
    return (struct place){bit, (cycles * RL_PACKET_BITS + bit) * transmission->bit_s,
                          cycles * packet->elapsed[RL_PACKET_BITS]};
}

/* The integral of the light since the start of the packet [s]; moves the place to that time. */
static double integral(const struct rl_transmission *transmission, const struct packet *packet,
                       double since_s, struct place *place)
{
    if (since_s <= 0.0 && !transmission->repeats) {
        return transmission->dark_before ? 0.0 : since_s;
    }
    double passed_s = since_s - place->bit_s;
    const int ends = transmission->repeats || place->bit < RL_PACKET_BITS; /* as idle does not */
    if (passed_s < 0.0 || (ends && passed_s >= transmission->bit_s)) {
        if (passed_s > 0.0 && passed_s < 2.0 * transmission->bit_s &&
            place->bit + 1 < RL_PACKET_BITS) {
            place->bit++;
            place->bit_s += transmission->bit_s;
        } else {
            *place = place_of(transmission, packet, since_s);
        }
        passed_s = since_s - place->bit_s;
    }
    return place->sent + packet->elapsed[place->bit] +
           relaxed(packet->level[place->bit], packet->level[place->bit + 1],
                   passed_s > 0.0 ? passed_s : 0.0);
}

void rl_template(const struct rl_transmission *transmission, const double *begin_s,
                 const double *end_s, int rows, double *light)
{
    struct packet packet;
    lay_out(transmission, &packet);
    struct place place = {0, 0.0, 0.0};
    double until = 0.0, until_s = -INFINITY;
    for (int row = 0; row < rows; row++) {
        const double from =
            begin_s[row] == until_s
                ? until
                : integral(transmission, &packet, begin_s[row] - transmission->start_s, &place);
        until_s = end_s[row];
        until = integral(transmission, &packet, until_s - transmission->start_s, &place);
        light[row] = (until - from) / (end_s[row] - begin_s[row]);
    }
}

void rl_train_light(const struct rl_packet_train *train, const double *begin_s,
                    const double *end_s, int rows, double *light)
{
    struct rl_transmission transmission = train->transmission;
    transmission.dark_before = transmission.dark_after = false; /* trains beside it tell that */
    rl_template(&transmission, begin_s, end_s, rows, light);
    /* What was read may begin within a packet; markers send whole ones. */
    const double packet_s = RL_PACKET_BITS * transmission.bit_s;
    const double before = (train->begin_s - transmission.start_s) / packet_s;
    const double from_s = transmission.start_s + packet_s * floor(before + WHOLE);
    for (int row = 0; transmission.repeats && row < rows && begin_s[row] < from_s; row++) {
        light[row] = 1.0;
    }
}

double rl_last_start(const struct rl_transmission *transmission, double until_s)
{
    const double packet_s = RL_PACKET_BITS * transmission->bit_s;
    return transmission->start_s +
           packet_s * floor((until_s - transmission->start_s) / packet_s);
}

double rl_bits_later(const struct rl_transmission *before, const struct rl_transmission *now)
{
    return remainder((now->start_s - before->start_s) / now->bit_s, RL_PACKET_BITS);
}

bool rl_keeps_time(const struct rl_packet_train *before, const struct rl_packet_train *now)
{
    return fabs(rl_bits_later(&before->transmission, &now->transmission)) < SAME_PHASE_BITS;
}
