/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether a packet is read: three questions to one likelihood.
 *
 * Evidence: is something there that wandering does not explain? Word: does no other sequence of
 * bits explain it much better? Margin: does no packet of another ID explain it nearly as well?
 */
#ifndef RETROLIDAR_DECIDE_H
#define RETROLIDAR_DECIDE_H

#include "retrolidar_search.h"
#include "retrolidar_window.h"

/* binding */
enum { RL_EVIDENCE, RL_NOT_A_WORD, RL_MARGIN, RL_INCOMPLETE, RL_ERASED, RL_READ };

/* What is asked of a packet [nats]. */
struct rl_demands {
    double evidence;
    double wandering;      /* more of it where the level wanders besides */
    double word;           /* by how much another sequence of bits may be better */
    double margin;         /* by how much a packet must be better than one of any other ID ... */
    double margin_of_more; /* ... if more of its packets may come */
};
/* end of binding */

enum {
    RL_SILENT_BITS = RL_PACKET_BITS, /* before a lone packet, which show its bright level */
    RL_MAX_BITS = RL_SILENT_BITS + RL_PACKET_BITS, /* that a window is cut into */
};

/* The bits of a window in the order of time: a packet's, and the silence before, too. */
struct rl_bits {
    int count, silent;
    int first;      /* which bit of the packet follows the silence */
    double begin_s; /* of the first of all [s] */
    bool dark[RL_MAX_BITS];
    bool dark_before, dark_after; /* the first and the last */
    /* Log likelihood if a bit were the other one, less that as it is. */
    float flipped[RL_MAX_BITS];
};

struct rl_verdict {
    int channel, packets; /* that the window holds */
    uint16_t id;
    struct rl_transmission transmission;
    bool is_dimmer;                /* whether it is of the dimmer target, if the zone has two */
    int reason;                    /* why it is rejected, or RL_READ */
    double evidence, word, margin; /* [nats], as far as it came */
    double begin_s, end_s;         /* of what was used */
    struct rl_gain fit;
};

/* A packet that is judged. */
struct rl_case {
    struct rl_window *window;
    const struct rl_codebook *codebook;
    const struct rl_demands *demands;
    const struct rl_hits *hits; /* that were found with it, rivals if they are of other IDs */
    double consumed_until_s;    /* end of the packet that was read last in the channel [s] */
    double since_s; /* earlier samples are left out, as its marker was not there [s] */
    double to_s;    /* end of the newest exposure [s] */
    bool follows;   /* whether packets of this ID and clock were read before */
    struct rl_verdict verdict; /* channel, packets, ID and transmission are given */
    /* And what is found: */
    bool is_new;      /* whether its marker has just appeared */
    int silent_bits;  /* of the window, before the packet */
    double half_bits; /* from the start to the middle of the window */
    double own;       /* its log likelihood */
    double price;     /* of a gain that changes along it [nats] */
    struct rl_bits bits;
};

/* How many bits have to be seen, at the least, of a packet that has appeared in its middle. */
double rl_decide_min_bits(const struct rl_codebook *codebook, const struct rl_demands *demands);

struct rl_verdict rl_decide(struct rl_case *judged);

#endif
