/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* When a marker sends: it sleeps, looks for the sensor's light in short windows, sends packets when
 * it sees it, and looks again.
 */
#ifndef RETROLIDAR_WAKEUP_H
#define RETROLIDAR_WAKEUP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

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

/* Report that all packets are sent. It looks again at once: as long as there is light, packets
 * follow packets.
 */
enum rl_mode rl_wakeup_sent(struct rl_wakeup *wakeup);

#ifdef __cplusplus
}
#endif

#endif
