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

/* What is found of a packet that is judged; what it has not come to is 0. */
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
    double word_before; /* statistic of the last one of these */
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

/* Open the window that a packet was found in, and refine it; for a lone packet that with the
 * silence before it, if it is the better one. Find evidence, begin, end, fit and where they are.
 */
void rl_observation_open(struct rl_case *judged);

/* Whether too many samples are erasures to decide the word. */
bool rl_observation_is_erased(const struct rl_case *judged);

/* Cut a window into the bits of a packet. */
struct rl_bits rl_bits_cut(const struct rl_transmission *transmission, int first, int silent);

/* Flip each bit that is seen in a part of the window, before a row or from it on; the others tell
 * nothing. From row 0 on, all are seen. `own` is of a packet that is seen in that part only.
 */
void rl_bits_flip(struct rl_case *judged, int split, bool later);

/* Log likelihood of the best sequence of bits that the search has found. */
double rl_word_sequence(const struct rl_case *judged);

/* Flip the bits of the packet. Return how much better a sequence is that differs from it in a few
 * bits, if not by far [nats].
 */
double rl_word_flip_bits(struct rl_case *judged);

/* How much better packets that repeat are explained if each has bits of its own, if not by far. */
double rl_word_packets(const struct rl_case *judged);

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
double rl_rivals_margin(const struct rl_case *judged);

/* The same if the marker of another ID came or went in the window; while away, it is dark. */
double rl_rivals_part_margin(const struct rl_case *judged);

/* The same of one that ended in the window, and another that began then. */
double rl_rivals_successive_margin(const struct rl_case *judged);

/* By how much any bits of another clock are likelier than a packet [nats]; own: its likelihood. */
double rl_clock_excess(struct rl_window *window, const struct rl_transmission *transmission,
                       double own);

/* By how much a channel correlates better with itself at another lag than a packet's length, over
 * all rows that are held [nats]: packets that are combined are too faint to be cut into other bits.
 */
double rl_clock_period_excess(struct rl_window *window, const struct rl_transmission *transmission);

#endif
