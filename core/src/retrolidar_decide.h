/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether a packet is read: three tests of one likelihood.
 *
 * Evidence: is it much likelier than a wandering level? Word: is no other sequence of bits much
 * likelier? Margin: is no packet of another ID nearly as likely?
 */
#ifndef RETROLIDAR_DECIDE_H
#define RETROLIDAR_DECIDE_H

#include "retrolidar_search.h"
#include "retrolidar_window.h"

/* binding */
enum { RL_EVIDENCE, RL_NOT_A_WORD, RL_MARGIN, RL_INCOMPLETE, RL_ERASED, RL_READ };

/* What is asked of a packet [nats]. */
struct rl_thresholds {
    double evidence;
    double wandering;      /* additional evidence if the level wanders */
    double word;           /* by how much another sequence of bits may be better */
    double margin;         /* by how much a packet must be better than one of any other ID ... */
    double margin_of_more; /* ... if more of its packets may come */
};

/* The result for a packet that is judged; tests that were not reached are 0. */
struct rl_verdict {
    int channel, packets; /* that the window holds */
    uint16_t id;
    struct rl_transmission transmission;
    bool is_dimmer;                /* whether it is of the dimmer target, if the zone has two */
    int reason;                    /* why it is rejected, or RL_READ */
    double evidence, word, margin; /* statistics of the tests [nats] */
    double begin_s, end_s;         /* of the samples used [s] */
};
/* end of binding */

enum {
    RL_SILENT_BITS = RL_PACKET_BITS, /* before a lone packet; they show its bright level */
    RL_MAX_BITS = RL_SILENT_BITS + RL_PACKET_BITS, /* that a window is cut into */
};

/* The bits of a window in the order of time: the silence, then the packet. */
struct rl_bits {
    int count, silent;
    int first;      /* which bit of the packet follows the silence */
    double begin_s; /* of the first of all [s] */
    bool dark[RL_MAX_BITS];
    bool dark_before, dark_after; /* of the bit before the first, and of that after the last */
    /* Log likelihood with this bit flipped, less that without. */
    float flipped[RL_MAX_BITS];
};

/* A packet that is judged. */
struct rl_case {
    struct rl_window *window;
    const struct rl_codebook *codebook;
    const struct rl_thresholds *thresholds;
    const struct rl_hits *hits; /* that were found with it, rivals if they are of other IDs */
    double read_until_s; /* end of the packet that was read last in the channel [s] */
    double since_s; /* earlier samples are left out, as its marker was not there [s] */
    double to_s;    /* end of the newest exposure [s] */
    bool follows;   /* whether packets of this ID and clock were read before */
    bool is_expected; /* whether it follows these, or a packet of any ID ends or begins with it */
    double word_before; /* word statistic of the last one of these */
    struct rl_verdict verdict; /* channel, packets, ID and transmission are given */
    /* And what is found: */
    bool is_new;      /* whether its marker has just appeared */
    int silent_bits;  /* of the window, before the packet */
    double half_bits; /* from the start to the middle of the window */
    double log_likelihood; /* of it */
    double price;          /* of a gain that changes along it [nats] */
    struct rl_bits bits;
};

/* The least number of bits that must be seen of a packet whose marker has just appeared. */
double rl_decide_min_bits(const struct rl_codebook *codebook,
                          const struct rl_thresholds *thresholds);

struct rl_verdict rl_decide(struct rl_case *judged);

/* Open the window of a packet, with the silence before a lone packet if that is better, and refine
 * start and bit period there. Find evidence, begin and end.
 */
void rl_observation_open(struct rl_case *judged);

/* Whether too many samples are erasures to decide the word. */
bool rl_observation_is_erased(const struct rl_case *judged);

/* Cut a window into the bits of a packet. */
struct rl_bits rl_bits_cut(const struct rl_transmission *transmission, int first, int silent);

/* Flip the bits of the packet. Return by how much the best sequence that differs in a few bits is
 * likelier [nats]; the search ends once that is too much.
 */
double rl_word_flip_bits(struct rl_case *judged, double too_much);

/* The same of the sequences of bits that the search has found. */
double rl_word_sequence(const struct rl_case *judged, double too_much);

/* How much likelier a packet is than one of any other ID: begun at any bit, cut by the window or
 * repeating, or found by the search with another start and clock.
 */
double rl_rivals_margin(const struct rl_case *judged);

/* The same if the marker of another ID came or went in the window; while away, it is dark. */
double rl_rivals_part_margin(const struct rl_case *judged);

/* The same of a packet that ended in the window, and another one that began then. */
double rl_rivals_successive_margin(const struct rl_case *judged);

/* Log likelihood of a known marker's last packet and a next one, and what makes that likelier. */
double rl_rivals_next(const struct rl_case *judged);

/* By how much any bits of another clock are likelier than a packet; own: its log likelihood. */
double rl_clock_excess(struct rl_window *window, const struct rl_transmission *transmission,
                       double own);

/* By how much a repetition after another lag than a packet's length is likelier, over all rows that
 * are held [nats]. Combined packets are too faint to try bits of another clock.
 */
double rl_clock_period_excess(struct rl_window *window, const struct rl_transmission *transmission);

#endif
