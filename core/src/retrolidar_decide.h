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

struct rl_verdict {
    int reason; /* why it is rejected, or RL_READ */
    struct rl_transmission transmission;
    uint16_t id;
    int packets;
    double evidence, word, margin; /* [nats], as far as it came */
    double begin_s, end_s;         /* of what was used */
    int channel;
    struct rl_gain fit;
};

/* How many bits have to be seen, at the least, of a packet that has appeared in its middle. */
double rl_decide_min_bits(const struct rl_codebook *codebook, const struct rl_demands *demands);

/* Judge a hit of a channel.
 *
 * hits: those that were found with it, rivals if they are of other IDs
 * packets: that the window holds
 * consumed_until_s: end of the packet that was read last in the channel [s]
 * since_s: earlier samples are left out, as its marker was not there [s]
 * follows: whether packets of this ID and clock were read before
 * to_s: end of the newest exposure [s]
 */
struct rl_verdict rl_decide(struct rl_window *window, const struct rl_codebook *codebook,
                            const struct rl_demands *demands, int channel, const struct rl_hit *hit,
                            const struct rl_hits *hits, int packets, double consumed_until_s,
                            double since_s, bool follows, double to_s);

#endif
