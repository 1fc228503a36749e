/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The light of packets in each exposure, with the response of the liquid crystal. */
#ifndef RETROLIDAR_TEMPLATE_H
#define RETROLIDAR_TEMPLATE_H

#include <stdbool.h>
#include <stdint.h>

/* binding */
/* Bits that a marker sends, and when. */
struct rl_transmission {
    uint32_t bits;  /* of a packet, the first one the most significant; 1 = dark */
    bool repeats;   /* back to back without end */
    double start_s; /* when a packet begins [s] */
    double bit_s;   /* how long a bit lasts [s] */
    /* Before and after a lone packet the marker is bright, but dark if it sends another packet
     * there that touches it with a dark bit.
     */
    bool dark_before, dark_after;
};
/* end of binding */

/* Packets of one ID that were read, back to back. */
struct rl_packet_train {
    struct rl_transmission transmission;
    double begin_s, end_s; /* of what was read [s] */
};

/* Mean light, 0 to 1, during exposures from begin_s to end_s; both of so many rows. */
void rl_template(const struct rl_transmission *transmission, const double *begin_s,
                 const double *end_s, int rows, double *light);

/* The same of a train: bright before what was read of it. One that repeats continues. */
void rl_train_light(const struct rl_packet_train *train, const double *begin_s,
                    const double *end_s, int rows, double *light);

enum { RL_MAX_TRAINS = 24 }; /* of a zone and those beside it, within a few packets */

/* Trains that may be in the samples besides the packet that is judged. */
struct rl_interference {
    int count;
    struct rl_packet_train train[RL_MAX_TRAINS];
};

/* When the last packet begins before a time, if a transmission is back to back with others. */
double rl_last_start(const struct rl_transmission *transmission, double until_s);

/* By how many bits a packet begins later than another one, or than the next after whole packets. */
double rl_bits_later(const struct rl_transmission *before, const struct rl_transmission *now);

/* Whether the packets of two trains begin at the same phase. */
bool rl_keeps_time(const struct rl_packet_train *before, const struct rl_packet_train *now);

#endif
