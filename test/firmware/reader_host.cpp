// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// Runs the reader's sketch: reader_host START_US PERIOD_US [BAUD] < frames > line
// A frame on standard input is one line: STATUS of the driver, then of each zone its targets,
// distance, signal, ambient light and status. At a status of 256 more, another frame is made while
// this one is read. A line "> TEXT" is typed to the sketch before the next frame. Frames are not
// seen while the sensor is stopped. The line is as fast as the sketch sets it, or slower by BAUD.
#include "../../firmware/reader/reader.ino"

static bool is_ready, sensor_ranges;
static uint8_t resolution;

static bool bus_has_begun, sensor_has_begun;
static uint64_t frame_us;

// How the X-NUCLEO-53L8A1 is wired.
SPIClass::SPIClass(uint32_t mosi, uint32_t miso, uint32_t clock)
{
    demand(mosi == D4 && miso == D5 && clock == D3, "pins of the bus");
}
void SPIClass::begin() { bus_has_begun = true; }
VL53L8CX::VL53L8CX(SPIClass *, int select, int lpn, int, uint32_t)
{
    demand(select == D10 && lpn == A3, "pins of the sensor");
}
int VL53L8CX::begin(uint16_t)
{
    sensor_has_begun = true;
    return 0;
}
uint8_t VL53L8CX::init()
{
    demand(bus_has_begun && sensor_has_begun && world.levels[D11] == HIGH,
           "the sensor is started before bus and power");
    return std::getenv("NO_SENSOR") ? 1 : 0;
}
uint8_t VL53L8CX::set_resolution(uint8_t zones)
{
    resolution = zones;
    return 0;
}
uint8_t VL53L8CX::set_ranging_frequency_hz(uint8_t hz)
{
    demand(resolution == 16 ? hz == 48 : hz == 15, "rate");
    return 0;
}
uint8_t VL53L8CX::set_ranging_mode(uint8_t mode)
{
    demand(mode == VL53L8CX_RANGING_MODE_CONTINUOUS, "mode");
    return 0;
}
uint8_t VL53L8CX::set_target_order(uint8_t order)
{
    demand(order == VL53L8CX_TARGET_ORDER_STRONGEST, "target order");
    return 0;
}
uint8_t VL53L8CX::set_sharpener_percent(uint8_t percent) { return percent >= 100; }
uint8_t VL53L8CX::start_ranging()
{
    demand(world.interrupt_pin == A2 && world.interrupt_edge == FALLING, "interrupt of the sensor");
    demand(world.modes[A2] == INPUT_PULLUP, "the sensor's interrupt has an open drain");
    is_ready = true;
    demand(!sensor_ranges, "the sensor is started twice");
    sensor_ranges = true;
    return 0;
}
uint8_t VL53L8CX::stop_ranging()
{
    demand(sensor_ranges, "the sensor is stopped twice");
    sensor_ranges = false;
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
    if (status >= 256) {
        world.pass(frame_us);
        world.on_interrupt();
    }
    return static_cast<uint8_t>(status % 256);
}

// Type what comes before the next frame, and skip frames that nobody sees.
static void type_and_skip()
{
    for (int next; (next = std::getchar()) != EOF;) {
        if (next == '>') {
            std::getchar(); // a space
            while ((next = std::getchar()) != '\n') {
                world.typed += static_cast<char>(next);
            }
            world.typed += '\n';
            loop();
        } else if (next != '\n' && sensor_ranges) {
            std::ungetc(next, stdin);
            return;
        }
    }
}

int main(int count, char **arguments)
{
    world.now_us = std::strtoull(arguments[1], nullptr, 10);
    frame_us = std::strtoull(arguments[2], nullptr, 10);
    const double slow_baud = count > 3 ? std::strtod(arguments[3], nullptr) : 0;
    double unsent = 0;
    uint64_t then_us = world.now_us;
    auto drain = [&] {
        const double baud = slow_baud > 0 ? slow_baud : static_cast<double>(world.baud);
        unsent -= static_cast<double>(world.now_us - then_us) * baud / 10 * 1e-6;
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
    setup();
    for (;;) {
        type_and_skip();
        world.pass(frame_us);
        world.on_interrupt();
        loop();
        loop(); // once more, as a board would: nothing is to be read, or a frame made meanwhile
    }
}
