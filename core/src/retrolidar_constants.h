/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Numbers that several files share. */
#ifndef RETROLIDAR_CONSTANTS_H
#define RETROLIDAR_CONSTANTS_H

#include "retrolidar_packet.h"

enum {
    RL_LANES = 16,    /* channels whose arithmetic is done side by side */
    RL_PHASES = 4,    /* of a bit, at which starts are tried */
    RL_TRIED = 3,     /* the likeliest of many, which are tried exactly, and rounds of trying */
    RL_LOOK_BITS = 4, /* between two searches of a stretch; fewer bits tell nothing */
    /* Parts of a packet, between which a marker may come or go. */
    RL_PARTS = (RL_PACKET_BITS + RL_LOOK_BITS - 1) / RL_LOOK_BITS,
    /* So long after a reading a marker may have sent the next one. */
    RL_CONTINUES_BITS = RL_PACKET_BITS + RL_LOOK_BITS / 2,
};

/* Bits by which a packet may begin before the one before it has ended. */
static const double RL_OVERLAP_BITS = 1.5;
/* By how much clocks may be off: three deviations of a microcontroller's oscillator, of 1 %. */
static const double RL_MAX_SKEW = 0.03;
/* A parameter more must explain half the logarithm of the number of samples [nats]. */
static const double RL_COST_OF_GAIN = 2.0;
/* What happens at a time that is chosen among some must explain this [nats]. */
static const double RL_COST_OF_CHANCE = 6.0;
/* Nobody asks for a greater margin, so greater ones need not be known exactly [nats]. */
static const double RL_MAX_MARGIN = 30.0;
/* Hypotheses that differ by less are as good [nats]. */
static const double RL_AS_GOOD = 1.0;
/* Share that is most of something: of evidence on coarse templates, or of what others hide. */
static const double RL_MOST = 0.7;
/* A zone has seen a packet if it has seen this share of what the strongest zone has. */
static const double RL_MIN_PART = 0.1;
/* What is this many deviations from nothing is no chance. */
static const double RL_MIN_SEEN = 3.0;
/* So near to the distance from which the sensor parts targets it may or may not. */
static const double RL_UNSURE_M = 0.05;
/* Samples with more light show the marker; with less than 1 - RL_BRIGHT, the background. */
static const double RL_BRIGHT = 0.75;

#endif
