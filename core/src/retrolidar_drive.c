/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_drive.h"

bool rl_drive_start(struct rl_drive *drive, uint16_t id, uint16_t packets, uint16_t ticks_per_bit)
{
    if (drive->busy || ticks_per_bit == 0 || ticks_per_bit % 2 != 0) {
        return false;
    }
    rl_schedule_start(&drive->schedule, rl_packet(id), packets);
    drive->ticks_per_bit = ticks_per_bit;
    drive->ticks_left = 0;
    drive->dark = false;
    drive->busy = true;
    return true;
}

enum rl_electrodes rl_drive_tick(struct rl_drive *drive)
{
    if (!drive->busy) {
        return RL_SHORTED;
    }
    if (drive->ticks_left == 0) {
        if (!rl_schedule_next(&drive->schedule, &drive->dark)) {
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
