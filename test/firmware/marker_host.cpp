// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// Runs the marker's sketch: marker_host SECONDS LIGHT_FROM_US LIGHT_UNTIL_US [TYPED...]
// Prints a line for each change of a pin: time [us], pin, level; what is said on the serial line,
// after a #; and at the end, after a $, how long the processor slept deeply and waited [us], and the ID in its memory. Each
// TYPED is a line on the console at the beginning. KEPT_ID in the environment is in the memory from
// an earlier run; ERASED is the byte that it holds otherwise.
#include "../../firmware/marker/marker.ino"

static uint64_t setting(const char *name)
{
    const char *text = std::getenv(name);
    return text == nullptr ? 0 : std::strtoull(text, nullptr, 10);
}

int main(int count, char **arguments)
{
    std::memset(EEPROM.bytes, static_cast<int>(setting("ERASED")), sizeof EEPROM.bytes);
    if (setting("KEPT_ID") != 0) {
        EEPROM.put(0, static_cast<uint16_t>(setting("KEPT_ID")));
    }
    const uint64_t end_us = 1000000 * std::strtoull(arguments[1], nullptr, 10);
    const uint64_t from_us = std::strtoull(arguments[2], nullptr, 10);
    const uint64_t until_us = std::strtoull(arguments[3], nullptr, 10);
    for (int i = 4; i < count; i++) {
        world.typed += std::string(arguments[i]) + "\r\n";
    }
    uint32_t levels[32] = {};
    uint64_t powered_us = 0;
    world.on_pin = [&](uint32_t pin, uint32_t value) {
        if (levels[pin] != value) {
            levels[pin] = value;
            std::printf("%llu %u %u\n", static_cast<unsigned long long>(world.now_us), pin, value);
            if (pin == FRONTEND_PIN && value == HIGH) {
                powered_us = world.now_us;
            }
        }
    };
    world.level = [&](uint32_t pin) {
        // The comparator answers 0.4 ms after it has power (paper section 5).
        const uint64_t for_us = world.now_us - powered_us;
        const bool is_lit = world.now_us >= from_us && world.now_us < until_us && for_us >= 400;
        return pin == LIGHT_PIN && levels[FRONTEND_PIN] == HIGH && is_lit;
    };
    world.on_serial = [&](const uint8_t *bytes, size_t size) {
        std::printf("#%.*s\n", static_cast<int>(size), reinterpret_cast<const char *>(bytes));
    };
    for (setup(); world.now_us < end_us;) {
        loop();
    }
    uint16_t kept = 0;
    std::printf("$%llu %llu %u\n", static_cast<unsigned long long>(world.deep_sleep_us),
                static_cast<unsigned long long>(world.waited_us), EEPROM.get(0, kept));
}
