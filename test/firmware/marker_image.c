/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * All that a marker calls of the core, linked without any other code, so that its flash and RAM can
 * be measured. What the hardware gives and takes is in volatile variables.
 */
#include "retrolidar_command.h"
#include "retrolidar_marker.h"

volatile uint16_t light;
volatile uint8_t electrodes;
static struct rl_drive drive;
static struct rl_wakeup wakeup;
static const struct rl_wakeup_settings SETTINGS = {99000, 1000, 6, 3};

void on_timer(void)
{
    electrodes = (uint8_t)rl_drive_tick(&drive);
}

void start(const char *line)
{
    uint16_t id = rl_command_id(line);
    rl_wakeup_start(&wakeup, &SETTINGS);
    for (;;) {
        if (rl_wakeup_step(&wakeup, 50, light) == RL_TRANSMIT) {
            rl_drive_start(&drive, id, 2, 84);
            while (drive.busy) {
                on_timer();
            }
            rl_wakeup_sent(&wakeup);
        }
    }
}
