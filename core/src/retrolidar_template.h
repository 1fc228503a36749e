/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What exposures see of a packet, the response of the liquid crystal included. */
#ifndef RETROLIDAR_TEMPLATE_H
#define RETROLIDAR_TEMPLATE_H

#include <stdbool.h>
#include <stdint.h>

/* Bits that a marker sends, and when. */
struct rl_transmission {
    uint32_t bits;  /* of a packet, the first one the most significant; 1 = dark */
    bool repeats;   /* back to back without end */
    double start_s; /* when a packet begins [s] */
    double bit_s;   /* how long a bit lasts [s] */
    /* A lone packet touches bright light if nothing else is sent; the bits of packets of other
     * IDs, back to back, may be dark.
     */
    bool dark_before, dark_after;
};

/* Packets of one ID that have been read, one behind the other. */
struct rl_packet_train {
    struct rl_transmission transmission;
    double begin_s, end_s; /* of what was read [s] */
};

/* Mean light, 0 to 1, during exposures from begin_s to end_s; both of so many rows. */
void rl_template(const struct rl_transmission *transmission, const double *begin_s,
                 const double *end_s, int rows, double *light);

/* The same of a train, as far as it was read, or as if it went on and on; bright before. */
void rl_train_light(const struct rl_packet_train *train, bool continues, const double *begin_s,
                    const double *end_s, int rows, double *light);

#endif
