/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a marker does: when it sends, and how bits get to its liquid crystal. */
#ifndef RETROLIDAR_MARKER_H
#define RETROLIDAR_MARKER_H

#include "retrolidar_packet.h"

#ifdef __cplusplus
extern "C" {
#endif

/* When a marker sends: it sleeps, looks for the sensor's light in short windows, sends packets when
 * it sees it, and looks again.
 */
enum rl_mode { RL_SLEEP, RL_DETECT, RL_TRANSMIT };

struct rl_wakeup_settings {
    uint32_t sleep_us;   /* between two looks */
    uint32_t look_us;    /* how long a look lasts without light */
    uint16_t threshold;  /* light of this level wakes, in any unit */
    uint16_t hysteresis; /* a marker that has sent goes on at so much less, below the threshold */
};

struct rl_wakeup {
    struct rl_wakeup_settings settings;
    uint32_t left_us; /* of this sleep or look */
    enum rl_mode mode;
    bool has_sent; /* since it last slept */
};

/* Begin with a look. */
void rl_wakeup_start(struct rl_wakeup *wakeup, const struct rl_wakeup_settings *settings);

/* Report how much time has passed in the present mode and, in RL_DETECT, the level of the light;
 * get the mode that follows. In RL_TRANSMIT nothing changes.
 */
enum rl_mode rl_wakeup_step(struct rl_wakeup *wakeup, uint32_t elapsed_us, uint16_t level);

/* Report that all packets are sent. It looks again at once: in light, packets follow packets. */
enum rl_mode rl_wakeup_sent(struct rl_wakeup *wakeup);

/* How bits get to the liquid crystal: a square wave without direct voltage while dark, both
 * electrodes at the same level while bright.
 */
enum rl_electrodes { RL_SHORTED, RL_FIRST_HIGH, RL_SECOND_HIGH };

/* Packets on their way, back to back. */
struct rl_drive {
    uint32_t packet;
    uint16_t packets_left; /* after the one that is being sent */
    uint8_t bits_left;     /* of that one */
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
