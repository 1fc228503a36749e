// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// The other side of the stand-in for an Arduino: what the world does to a sketch, and what it
// demands of it.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

#include "Arduino.h"

struct World {
    uint64_t now_us = 0;
    std::function<int(uint32_t pin)> level = [](uint32_t) { return int{LOW}; };
    std::function<void(uint32_t pin, uint32_t value)> on_pin = [](uint32_t, uint32_t) {};
    std::function<void(const uint8_t *bytes, size_t count)> on_serial =
        [](const uint8_t *, size_t) {};
    std::function<int()> writable = [] { return 1 << 16; };
    std::string typed; // on the serial line, not read yet
    bool is_flushed = true;
    uint64_t deep_sleep_us = 0;
    uint64_t waited_us = 0; // for interrupts

    // What the sketch has set.
    uint32_t modes[32] = {};
    uint32_t levels[32] = {};
    unsigned long baud = 0;
    std::function<void()> on_interrupt;
    uint32_t interrupt_pin = 0, interrupt_edge = 0;

    // Let time pass; the running timer calls its function each time that its period is over.
    void pass(uint64_t microseconds);
};
extern World world;

// End the program with a complaint unless something is as it must be.
void demand(bool is_so, const char *what);

void setup();
void loop();
