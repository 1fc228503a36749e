// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// What the sketches use of STM32duino's core and libraries, declared as there, on a machine whose
// time passes only while a sketch waits: what the world does to a sketch, and what it demands of it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <string>

enum { LOW, HIGH };
enum { INPUT, OUTPUT, INPUT_PULLUP, INPUT_PULLDOWN };
enum { CHANGE = 1, FALLING, RISING };
enum : uint32_t { D2 = 2, D3, D4, D5, D9 = 9, D10, D11, LED_BUILTIN = 13, A2 = 16, A3 };

void setup();
void loop();

// End the program with a complaint unless something is as it must be.
inline void demand(bool is_so, const char *what)
{
    if (!is_so) {
        std::fflush(stdout);
        std::fprintf(stderr, "%s\n", what);
        std::exit(4);
    }
}

constexpr uint32_t TIMER_HZ = 84000000, TIMER_PER_US = TIMER_HZ / 1000000;

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
    uint64_t watchdog_us = 0, reloaded_us = 0;
    bool tick_runs = true;

    // A sketch has one timer.
    bool timer_runs = false;
    uint32_t prescaler = 1;
    uint64_t period_ticks = 1ull << 32, timer_next_us = 0;
    std::function<void()> on_timer;

    uint64_t timer_period_us() const { return period_ticks * prescaler / TIMER_PER_US; }

    // Let time pass; the running timer calls its function each time that its period is over.
    void pass(uint64_t microseconds)
    {
        const uint64_t end_us = now_us + microseconds;
        while (timer_runs && on_timer && timer_next_us <= end_us) {
            now_us = timer_next_us;
            timer_next_us += timer_period_us();
            on_timer();
        }
        now_us = end_us;
        demand(watchdog_us == 0 || now_us - reloaded_us < watchdog_us,
               "the watchdog was not reloaded in time");
    }
};
inline World world;

inline void pinMode(uint32_t pin, uint32_t mode) { world.modes[pin] = mode; }
inline void digitalWrite(uint32_t pin, uint32_t value)
{
    demand(world.modes[pin] == OUTPUT, "a pin is written that is no output");
    world.levels[pin] = value;
    world.on_pin(pin, value);
}
inline int digitalRead(uint32_t pin)
{
    if (world.modes[pin] == OUTPUT) {
        return static_cast<int>(world.levels[pin]);
    }
    demand(world.modes[pin] != INPUT, "an input without a circuit would float");
    return world.level(pin);
}
inline uint32_t digitalPinToInterrupt(uint32_t pin) { return pin; }
inline void attachInterrupt(uint32_t pin, std::function<void()> callback, uint32_t mode)
{
    world.interrupt_pin = pin;
    world.interrupt_edge = mode;
    world.on_interrupt = callback;
}
inline void noInterrupts() {}
inline void interrupts() {}
inline void delay(uint32_t milliseconds) { world.pass(uint64_t{1000} * milliseconds); }
inline void delayMicroseconds(uint32_t microseconds) { world.pass(microseconds); }
inline uint32_t millis()
{
    world.pass(10); // or a loop that only waits for the time would never end
    return static_cast<uint32_t>(world.now_us / 1000);
}
inline void __WFI()
{
    demand(world.timer_runs, "nothing would end the waiting");
    const uint64_t until_us = world.timer_next_us - world.now_us;
    world.waited_us += until_us;
    world.pass(until_us);
}
extern "C" void HAL_Delay(uint32_t milliseconds); // weak in the core: the marker has its own
inline void HAL_SuspendTick() { world.tick_runs = false; }
inline void HAL_ResumeTick() { world.tick_runs = true; }
inline uint32_t HAL_GetUIDw0() { return 0x03020100; }
inline uint32_t HAL_GetUIDw1() { return 0x07060504; }
inline uint32_t HAL_GetUIDw2() { return 0x0b0a0908; }
[[noreturn]] inline void NVIC_SystemReset()
{
    demand(world.is_flushed, "a reset would cut off what is on the line");
    std::exit(0);
}

struct HardwareSerial {
    void begin(unsigned long baud) { world.baud = baud; }
    void end() { world.baud = 0; }
    void flush() { world.is_flushed = true; }
    int available() { return static_cast<int>(world.typed.size()); }
    int read()
    {
        const char typed = world.typed.front();
        world.typed.erase(0, 1);
        return typed;
    }
    int availableForWrite() { return world.writable(); }
    size_t write(uint8_t byte) { return write(&byte, 1); }
    size_t write(const uint8_t *bytes, size_t count)
    {
        demand(world.baud != 0, "the serial line is not open");
        world.is_flushed = false;
        world.on_serial(bytes, count);
        return count;
    }
    size_t print(const char *text)
    {
        return write(reinterpret_cast<const uint8_t *>(text), std::strlen(text));
    }
    size_t print(int number) { return print(std::to_string(number).c_str()); }
};
inline HardwareSerial Serial;

struct TIM_TypeDef;
inline TIM_TypeDef *const TIM2 = nullptr;
inline TIM_TypeDef *const TIM5 = nullptr;
enum TimerFormat_t { TICK_FORMAT, MICROSEC_FORMAT };

struct HardwareTimer {
    explicit HardwareTimer(TIM_TypeDef *) {}
    void pause() { world.timer_runs = false; }
    void resume()
    {
        world.timer_runs = true;
        world.timer_next_us = world.now_us + world.timer_period_us();
    }
    void setPrescaleFactor(uint32_t prescaler) { world.prescaler = prescaler; }
    void setOverflow(uint32_t value, TimerFormat_t format = TICK_FORMAT)
    {
        world.period_ticks = format == TICK_FORMAT
                                 ? value
                                 : uint64_t{value} * TIMER_PER_US / world.prescaler;
    }
    void setCount(uint32_t, TimerFormat_t = TICK_FORMAT) {}
    uint32_t getCount(TimerFormat_t = TICK_FORMAT)
    {
        demand(world.timer_runs, "a timer is read that stands still");
        const uint64_t ticks = world.now_us * TIMER_PER_US / world.prescaler;
        return static_cast<uint32_t>(ticks % world.period_ticks);
    }
    uint32_t getTimerClkFreq() { return TIMER_HZ; }
    void attachInterrupt(std::function<void()> callback) { world.on_timer = callback; }
};

struct EEPROMClass {
    uint8_t bytes[64] = {};

    template <typename T> T &get(int index, T &value)
    {
        std::memcpy(&value, bytes + index, sizeof value);
        return value;
    }
    template <typename T> const T &put(int index, const T &value)
    {
        std::memcpy(bytes + index, &value, sizeof value);
        return value;
    }
};
inline EEPROMClass EEPROM;

struct IWatchdogClass {
    void begin(uint32_t timeout_us)
    {
        world.watchdog_us = timeout_us;
        reload();
    }
    void reload() { world.reloaded_us = world.now_us; }
};
inline IWatchdogClass IWatchdog;

struct STM32LowPower {
    bool is_ready = false;

    void begin() { is_ready = true; }
    void deepSleep(uint32_t milliseconds)
    {
        demand(is_ready, "deep sleep was not begun");
        demand(world.baud == 0, "the serial line would keep the processor awake");
        // As version 1.5.0: the tick ends it early where a debugger was, and it waits afterwards.
        const uint32_t slept = world.tick_runs ? 1 : milliseconds;
        world.deep_sleep_us += uint64_t{1000} * slept;
        delay(slept);
        HAL_Delay(10);
    }
};
inline STM32LowPower LowPower;

struct SPIClass {
    SPIClass(uint32_t mosi, uint32_t miso, uint32_t clock);
    void begin();
};

// STM32duino's VL53L8CX, for the flags of the reader's build.
#define VL53L8CX_NB_TARGET_PER_ZONE 1U
#define VL53L8CX_RESOLUTION_8X8 ((uint8_t)64U)
#define VL53L8CX_RANGING_MODE_CONTINUOUS ((uint8_t)1U)
#define VL53L8CX_TARGET_ORDER_STRONGEST ((uint8_t)2U)
#define VL53L8CX_STATUS_OK ((uint8_t)0U)

struct VL53L8CX_ResultsData {
    uint32_t ambient_per_spad[VL53L8CX_RESOLUTION_8X8];
    uint8_t nb_target_detected[VL53L8CX_RESOLUTION_8X8];
    uint32_t signal_per_spad[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
    int16_t distance_mm[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
    uint8_t target_status[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
};

struct VL53L8CX {
    VL53L8CX(SPIClass *spi, int select_pin, int lpn_pin = -1, int i2c_reset_pin = -1,
             uint32_t spi_speed = 5000000);
    int begin(uint16_t new_i2c_address = 0x52);
    uint8_t init();
    uint8_t set_resolution(uint8_t resolution);
    uint8_t set_ranging_frequency_hz(uint8_t frequency_hz);
    uint8_t set_ranging_mode(uint8_t ranging_mode);
    uint8_t set_target_order(uint8_t target_order);
    uint8_t set_sharpener_percent(uint8_t sharpener_percent);
    uint8_t start_ranging();
    uint8_t stop_ranging();
    uint8_t get_ranging_data(VL53L8CX_ResultsData *results);
};
