/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Packets that may be in the samples besides the one in question, marker by marker. */
#ifndef RETROLIDAR_INTERFERENCE_H
#define RETROLIDAR_INTERFERENCE_H

#include "retrolidar_likelihood.h"
#include "retrolidar_template.h"

#include <stdbool.h>

enum { RL_MAX_TRAINS = 24 }; /* of a zone and those beside it, within a few packets */

struct rl_interference {
    int count;
    struct rl_packet_train train[RL_MAX_TRAINS];
};

/* Whether a train begins where the packets of another one would begin, too. */
bool rl_keeps_time(const struct rl_packet_train *before, const struct rl_packet_train *now);

/* Return the first train that the marker of one has sent: those that keep its time, and do not
 * overlap, are taken to be of one marker, whatever their IDs.
 */
int rl_interference_marker(const struct rl_interference *interference, int index);

/* Mean light, 0 to 1, of a marker during exposures: what it was seen to send, and bright else.
 *
 * marker: its first train
 * continues: whether its last packet is sent on and on
 * part: room for as many rows
 */
void rl_interference_light(const struct rl_interference *interference, int marker, bool continues,
                           const double *begin_s, const double *end_s, int rows, double *part,
                           double *light);

#endif
