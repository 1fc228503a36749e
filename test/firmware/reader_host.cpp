// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// Runs the reader's sketch: reader_host START_US PERIOD_US BAUD < frames > line
// A frame on standard input is one line: STATUS of the driver, then of each zone its targets,
// distance, signal, ambient light and status.
#include "../../firmware/reader/reader.ino"

#include <cstdio>
#include <cstdlib>

#include "arduino_host.h"

static bool is_ready;
static uint8_t resolution;

SPIClass::SPIClass(uint32_t, uint32_t, uint32_t) {}
void SPIClass::begin() {}
VL53L8CX::VL53L8CX(SPIClass *, int, int, int, uint32_t) {}
int VL53L8CX::begin(uint16_t) { return 0; }
uint8_t VL53L8CX::init() { return std::getenv("NO_SENSOR") ? 1 : 0; }
uint8_t VL53L8CX::set_resolution(uint8_t zones)
{
    resolution = zones;
    return 0;
}
uint8_t VL53L8CX::set_ranging_frequency_hz(uint8_t hz)
{
    return hz > (resolution == 16 ? 60 : 15); // as the driver refuses
}
uint8_t VL53L8CX::set_ranging_mode(uint8_t) { return 0; }
uint8_t VL53L8CX::set_target_order(uint8_t) { return 0; }
uint8_t VL53L8CX::set_sharpener_percent(uint8_t percent) { return percent >= 100; }
uint8_t VL53L8CX::start_ranging()
{
    is_ready = true;
    return 0;
}
uint8_t VL53L8CX::get_ranging_data(VL53L8CX_ResultsData *results)
{
    unsigned status = 0;
    if (std::scanf("%u", &status) != 1) {
        std::exit(0);
    }
    for (uint8_t i = 0; i < resolution; i++) {
        if (std::scanf("%hhu %hd %u %u %hhu", &results->nb_target_detected[i],
                       &results->distance_mm[i], &results->signal_per_spad[i],
                       &results->ambient_per_spad[i], &results->target_status[i]) != 5) {
            std::exit(1);
        }
    }
    return static_cast<uint8_t>(status);
}

int main(int, char **arguments)
{
    world.now_us = std::strtoull(arguments[1], nullptr, 10);
    const uint64_t period_us = std::strtoull(arguments[2], nullptr, 10);
    const double bytes_per_us = std::strtod(arguments[3], nullptr) / 10 * 1e-6;
    double unsent = 0;
    uint64_t then_us = world.now_us;
    auto drain = [&] {
        unsent -= static_cast<double>(world.now_us - then_us) * bytes_per_us;
        unsent = unsent < 0 ? 0 : unsent;
        then_us = world.now_us;
    };
    world.writable = [&] {
        drain();
        return SERIAL_TX_BUFFER_SIZE - 1 - static_cast<int>(unsent);
    };
    world.on_serial = [&](const uint8_t *bytes, size_t count) {
        drain();
        unsent += static_cast<double>(count);
        std::fwrite(bytes, 1, count, stdout);
        if (!is_ready && bytes[count - 1] == 0) { // the complaint repeats for ever
            std::exit(3);
        }
    };
    for (setup();; loop()) {
        world.pass(period_us);
        world.on_interrupt();
    }
}
