/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Numbers that several files share. */
#ifndef RETROLIDAR_CONSTANTS_H
#define RETROLIDAR_CONSTANTS_H

#include "retrolidar_packet.h"

enum {
    RL_LANES = 16,    /* channels that are computed at once, as a vector */
    RL_PHASES = 4,    /* starts that are tried in each bit */
    RL_TRIED = 3,     /* best candidates that are tried exactly, and rounds of a refinement */
    RL_LOOK_BITS = 4, /* between two searches of a stretch; fewer bits tell nothing */
    /* Parts of a packet: a marker may appear or vanish between two. */
    RL_PARTS = (RL_PACKET_BITS + RL_LOOK_BITS - 1) / RL_LOOK_BITS,
    RL_KNOTS = RL_PARTS - 1, /* of a gain that changes */
    /* A packet that ended longer ago is not subtracted: its marker has sent another one since. */
    RL_CONTINUES_BITS = RL_PACKET_BITS + RL_LOOK_BITS / 2,
};

/* Bits by which two packets that follow each other may overlap. */
static const double RL_OVERLAP_BITS = 1.5;
/* Largest relative error of a marker's clock: three deviations of an oscillator of 1 %. */
static const double RL_MAX_SKEW = 0.03;
/* A further parameter must explain half the logarithm of the number of samples [nats]. */
static const double RL_COST_OF_GAIN = 2.0;
/* An event at an unknown time must explain this [nats]. */
static const double RL_COST_OF_CHANCE = 6.0;
/* No threshold of the margin is higher, so larger margins are not computed exactly [nats]. */
static const double RL_MAX_MARGIN = 30.0;
/* Hypotheses that differ by less count as equal [nats]. */
static const double RL_AS_GOOD = 1.0;
/* Share that counts as most: of the evidence, or of the variance of a zone. */
static const double RL_MOST = 0.7;
/* A zone has seen a packet if it has this share of the strongest zone's light. */
static const double RL_MIN_PART = 0.1;
/* A value is significant if it is this many standard deviations from zero. */
static const double RL_MIN_SEEN = 3.0;
/* So near to `separable_m`, the sensor may separate two targets or merge them. */
static const double RL_UNSURE_M = 0.05;
/* A sample with more light shows the marker; with less than 1 - RL_BRIGHT, the background. */
static const double RL_BRIGHT = 0.75;

#endif
