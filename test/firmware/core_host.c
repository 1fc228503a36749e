/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * Answers questions to the core, a line each, on standard input.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "retrolidar_command.h"
#include "retrolidar_drive.h"
#include "retrolidar_packet.h"
#include "retrolidar_wakeup.h"
#include "retrolidar_wire.h"

static unsigned long long number(void)
{
    const char *word = strtok(NULL, " \n");
    return word == NULL ? 0 : strtoull(word, NULL, 10);
}

static void drive(void)
{
    struct rl_drive state = {0};
    uint16_t id = (uint16_t)number();
    uint16_t packets = (uint16_t)number();
    if (!rl_drive_start(&state, id, packets, (uint16_t)number())) {
        puts("refused");
        return;
    }
    for (;;) {
        enum rl_electrodes electrodes = rl_drive_tick(&state);
        if (state.busy && rl_drive_start(&state, id, 1, 2)) {
            puts("started twice");
            return;
        }
        if (!state.busy) {
            break;
        }
        putchar("0+-"[electrodes]);
    }
    /* Further calls give the state of rest. */
    puts(rl_drive_tick(&state) == RL_SHORTED && !state.busy ? "" : "still busy");
}

/* Each word after the settings: a level of light, which lasts for one step, or S for sent. */
static void wakeup(void)
{
    struct rl_wakeup_settings settings;
    struct rl_wakeup state;
    uint32_t step_us;
    settings.sleep_us = (uint32_t)number();
    settings.look_us = (uint32_t)number();
    settings.threshold = (uint16_t)number();
    settings.hysteresis = (uint16_t)number();
    step_us = (uint32_t)number();
    rl_wakeup_start(&state, &settings);
    for (const char *word; (word = strtok(NULL, " \n")) != NULL;) {
        enum rl_mode mode = word[0] == 'S'
                                ? rl_wakeup_sent(&state)
                                : rl_wakeup_step(&state, step_us, (uint16_t)atoi(word));
        putchar("sdt"[mode]);
    }
    putchar('\n');
}

static void frame(void)
{
    struct rl_frame content;
    struct rl_zone zones[64];
    /* Of the exact size, on the heap, where the sanitizer sees a byte too many. */
    size_t capacity;
    uint8_t *line;
    size_t bytes;
    content.sequence = (uint32_t)number();
    content.sensor_time_us = number();
    content.rows = (uint8_t)number();
    capacity = (size_t)number();
    content.zones = zones;
    for (size_t i = 0; i < 64; i++) {
        uint8_t targets = (uint8_t)number();
        int16_t distance = (int16_t)((int)number() - 32768);
        uint32_t signal = (uint32_t)number();
        uint32_t ambient = (uint32_t)number();
        zones[i] = rl_zone_of(targets, distance, signal, ambient, (uint8_t)number());
    }
    line = malloc(capacity + 1);
    bytes = rl_wire_encode(&content, line, capacity);
    for (size_t i = 0; i < bytes; i++) {
        printf("%02x", line[i]);
    }
    putchar('\n');
    free(line);
}

int main(void)
{
    static char line[1 << 16];
    while (fgets(line, sizeof line, stdin) != NULL) {
        if (strncmp(line, "command ", 8) == 0) {
            line[strcspn(line, "\n")] = '\0';
            printf("%u\n", rl_command_id(line + 8));
        } else {
            const char *question = strtok(line, " \n");
            if (strcmp(question, "packet") == 0) {
                printf("%" PRIu32 "\n", rl_packet((uint16_t)number()));
            } else if (strcmp(question, "usable") == 0) {
                printf("%d\n", rl_id_is_usable((uint32_t)number()));
            } else if (strcmp(question, "capacity") == 0) {
                unsigned long long zones = number();
                printf("%llu\n", RL_WIRE_BYTES(zones));
            } else if (strcmp(question, "extend") == 0) {
                uint64_t last_us = number();
                printf("%" PRIu64 "\n", rl_extend_us(last_us, (uint32_t)number()));
            } else if (strcmp(question, "drive") == 0) {
                drive();
            } else if (strcmp(question, "wakeup") == 0) {
                wakeup();
            } else if (strcmp(question, "frame") == 0) {
                frame();
            } else {
                return 2;
            }
        }
        fflush(stdout);
    }
    return 0;
}
