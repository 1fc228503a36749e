/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_marker.h"

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

bool rl_drive_start(struct rl_drive *drive, uint16_t id, uint16_t packets, uint16_t ticks_per_bit)
{
    if (drive->busy || ticks_per_bit == 0 || ticks_per_bit % 2 != 0) {
        return false;
    }
    drive->packet = rl_packet(id);
    drive->packets_left = packets;
    drive->bits_left = 0;
    drive->ticks_per_bit = ticks_per_bit;
    drive->ticks_left = 0;
    drive->dark = false;
    drive->busy = true;
    return true;
}

/* Take the next bit; false when all have been sent. */
static bool next_bit(struct rl_drive *drive)
{
    if (drive->bits_left == 0) {
        if (drive->packets_left == 0) {
            return false;
        }
        drive->packets_left--;
        drive->bits_left = RL_PACKET_BITS;
    }
    drive->bits_left--;
    drive->dark = (drive->packet >> drive->bits_left) & 1u;
    return true;
}

enum rl_electrodes rl_drive_tick(struct rl_drive *drive)
{
    if (!drive->busy) {
        return RL_SHORTED;
    }
    if (drive->ticks_left == 0) {
        if (!next_bit(drive)) {
            drive->busy = false;
            return RL_SHORTED;
        }
        drive->ticks_left = drive->ticks_per_bit;
    }
    drive->ticks_left--;
    if (!drive->dark) {
        return RL_SHORTED;
    }
    return drive->ticks_left % 2 != 0 ? RL_FIRST_HIGH : RL_SECOND_HIGH;
}
