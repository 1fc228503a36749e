/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Numbers that several files share. */
#ifndef RETROLIDAR_CONSTANTS_H
#define RETROLIDAR_CONSTANTS_H

#include "retrolidar_packet.h"

enum {
    RL_PHASES = 4,    /* of a bit, at which starts are tried */
    RL_TRIED = 3,     /* the likeliest of many, which are tried exactly */
    RL_PARTS = 8,     /* of a packet, between which a marker may come or go */
    RL_LOOK_BITS = 4, /* between two searches of a stretch; fewer bits tell nothing */
    /* A marker sends its next packet within a packet and these bits. */
    RL_LATE_BITS = 2,
    RL_GOES_ON_BITS = RL_PACKET_BITS + RL_LATE_BITS,
};

/* A clock may be off by so much from what is expected. */
static const double RL_MAX_SKEW = 0.03;
/* Each zone has a gain of its own, half the logarithm of the number of samples [nats]. */
static const double RL_COST_OF_GAIN = 2.0;
/* What happens at a time that is chosen among some must explain this [nats]. */
static const double RL_COST_OF_CHANCE = 6.0;
/* Hypotheses that differ by less are as good [nats]. */
static const double RL_AS_GOOD = 1.0;
/* Share of the evidence in demand that a coarse template, or a packet that others hide, must have. */
static const double RL_COARSE = 0.7;
/* Samples with more light than the first show the marker; with less than the second, the background. */
static const double RL_BRIGHT = 0.75, RL_DARK = 0.25;

#endif
