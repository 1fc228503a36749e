/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* How bits get to the liquid crystal: a square wave without direct voltage while dark, both
 * electrodes at the same level while bright.
 */
#ifndef RETROLIDAR_DRIVE_H
#define RETROLIDAR_DRIVE_H

#include "retrolidar_packet.h"

#ifdef __cplusplus
extern "C" {
#endif

enum rl_electrodes { RL_SHORTED, RL_FIRST_HIGH, RL_SECOND_HIGH };

struct rl_drive {
    struct rl_schedule schedule;
    uint16_t ticks_per_bit;
    uint16_t ticks_left; /* of this bit */
    bool dark;
    bool busy; /* until all packets are sent */
};

/* Begin to send packets; a drive is all zeros before it is used for the first time.
 *
 * ticks_per_bit: half periods of the square wave in a bit. It must be even and above 0, so that
 * each dark bit has as much of one polarity as of the other; else nothing starts, and the answer
 * is false. So it is while packets are being sent: a bit that is cut off would leave direct
 * voltage.
 */
bool rl_drive_start(struct rl_drive *drive, uint16_t id, uint16_t packets, uint16_t ticks_per_bit);

/* Take the electrodes to their next state; to be called once every half period. */
enum rl_electrodes rl_drive_tick(struct rl_drive *drive);

#ifdef __cplusplus
}
#endif

#endif
