/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_wakeup.h"

static void look(struct rl_wakeup *wakeup)
{
    wakeup->mode = RL_DETECT;
    wakeup->left_us = wakeup->settings.look_us;
}

static bool is_lit(const struct rl_wakeup *wakeup, uint16_t level)
{
    const struct rl_wakeup_settings *settings = &wakeup->settings;
    uint16_t needed = settings->threshold;
    /* A hysteresis as large as the threshold would keep the marker awake in the dark. */
    if (wakeup->has_sent && settings->hysteresis < settings->threshold) {
        needed -= settings->hysteresis;
    }
    return level >= needed;
}

void rl_wakeup_start(struct rl_wakeup *wakeup, const struct rl_wakeup_settings *settings)
{
    wakeup->settings = *settings;
    wakeup->has_sent = false;
    look(wakeup);
}

enum rl_mode rl_wakeup_step(struct rl_wakeup *wakeup, uint32_t elapsed_us, uint16_t level)
{
    if (wakeup->mode == RL_TRANSMIT) {
        return RL_TRANSMIT;
    }
    if (wakeup->mode == RL_DETECT && is_lit(wakeup, level)) {
        wakeup->mode = RL_TRANSMIT;
    } else if (elapsed_us < wakeup->left_us) {
        wakeup->left_us -= elapsed_us;
    } else if (wakeup->mode == RL_SLEEP) {
        look(wakeup);
    } else {
        wakeup->mode = RL_SLEEP;
        wakeup->left_us = wakeup->settings.sleep_us;
        wakeup->has_sent = false;
    }
    return wakeup->mode;
}

enum rl_mode rl_wakeup_sent(struct rl_wakeup *wakeup)
{
    wakeup->has_sent = true;
    look(wakeup);
    return wakeup->mode;
}
