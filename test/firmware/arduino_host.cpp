// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#include "arduino_host.h"

#include <cstdio>
#include <cstdlib>
#include <cstring>

#include "EEPROM.h"
#include "IWatchdog.h"
#include "STM32LowPower.h"

World world;
HardwareSerial Serial;
EEPROMClass EEPROM = {};
STM32LowPower LowPower;
IWatchdogClass IWatchdog;
TIM_TypeDef *const TIM2 = nullptr;
TIM_TypeDef *const TIM5 = nullptr;

constexpr uint32_t TIMER_HZ = 84000000;
// A sketch has one timer.
static struct {
    bool runs;
    uint32_t prescaler = 1;
    uint64_t period_ticks = 1ull << 32;
    uint64_t next_us;
    std::function<void()> callback;

    uint64_t ticks() const { return world.now_us * (TIMER_HZ / 1000000) / prescaler; }
    uint64_t period_us() const { return period_ticks * prescaler / (TIMER_HZ / 1000000); }
} timer;
static struct {
    uint64_t timeout_us;
    uint64_t reloaded_us;
} watchdog;
static bool tick_runs = true;
static bool low_power_is_ready;

void demand(bool is_so, const char *what)
{
    if (!is_so) {
        std::fflush(stdout);
        std::fprintf(stderr, "%s\n", what);
        std::exit(4);
    }
}

void World::pass(uint64_t microseconds)
{
    const uint64_t end_us = now_us + microseconds;
    while (timer.runs && timer.callback && timer.next_us <= end_us) {
        now_us = timer.next_us;
        timer.next_us += timer.period_us();
        timer.callback();
    }
    now_us = end_us;
    demand(watchdog.timeout_us == 0 || now_us - watchdog.reloaded_us < watchdog.timeout_us,
           "the watchdog was not reloaded in time");
}

void pinMode(uint32_t pin, uint32_t mode) { world.modes[pin] = mode; }
void digitalWrite(uint32_t pin, uint32_t value)
{
    demand(world.modes[pin] == OUTPUT, "a pin is written that is no output");
    world.levels[pin] = value;
    world.on_pin(pin, value);
}
int digitalRead(uint32_t pin)
{
    if (world.modes[pin] == OUTPUT) {
        return static_cast<int>(world.levels[pin]);
    }
    demand(world.modes[pin] != INPUT, "an input without a circuit would float");
    return world.level(pin);
}
uint32_t digitalPinToInterrupt(uint32_t pin) { return pin; }
void attachInterrupt(uint32_t pin, std::function<void()> callback, uint32_t mode)
{
    world.interrupt_pin = pin;
    world.interrupt_edge = mode;
    world.on_interrupt = callback;
}
void noInterrupts() {}
void interrupts() {}
void delay(uint32_t milliseconds) { world.pass(uint64_t{1000} * milliseconds); }
void delayMicroseconds(uint32_t microseconds) { world.pass(microseconds); }
uint32_t millis()
{
    world.pass(10); // or a loop that only waits for the time would never end
    return static_cast<uint32_t>(world.now_us / 1000);
}
void __WFI()
{
    demand(timer.runs, "nothing would end the waiting");
    const uint64_t until_us = timer.next_us - world.now_us;
    world.waited_us += until_us;
    world.pass(until_us);
}
__attribute__((weak)) void HAL_Delay(uint32_t milliseconds) { delay(milliseconds); }
void HAL_SuspendTick() { tick_runs = false; }
void HAL_ResumeTick() { tick_runs = true; }
uint32_t HAL_GetUIDw0() { return 0x03020100; }
uint32_t HAL_GetUIDw1() { return 0x07060504; }
uint32_t HAL_GetUIDw2() { return 0x0b0a0908; }
void NVIC_SystemReset()
{
    demand(world.is_flushed, "a reset would cut off what is on the line");
    std::exit(0);
}

void HardwareSerial::begin(unsigned long baud) { world.baud = baud; }
void HardwareSerial::end() { world.baud = 0; }
void HardwareSerial::flush() { world.is_flushed = true; }
int HardwareSerial::available() { return static_cast<int>(world.typed.size()); }
int HardwareSerial::read()
{
    const char typed = world.typed.front();
    world.typed.erase(0, 1);
    return typed;
}
int HardwareSerial::availableForWrite() { return world.writable(); }
size_t HardwareSerial::write(uint8_t byte) { return write(&byte, 1); }
size_t HardwareSerial::write(const uint8_t *bytes, size_t count)
{
    demand(world.baud != 0, "the serial line is not open");
    world.is_flushed = false;
    world.on_serial(bytes, count);
    return count;
}
size_t HardwareSerial::print(const char *text)
{
    return write(reinterpret_cast<const uint8_t *>(text), std::strlen(text));
}
size_t HardwareSerial::print(int number) { return print(std::to_string(number).c_str()); }

HardwareTimer::HardwareTimer(TIM_TypeDef *) {}
void HardwareTimer::pause() { timer.runs = false; }
void HardwareTimer::resume()
{
    timer.runs = true;
    timer.next_us = world.now_us + timer.period_us();
}
void HardwareTimer::setPrescaleFactor(uint32_t prescaler) { timer.prescaler = prescaler; }
void HardwareTimer::setOverflow(uint32_t value, TimerFormat_t format)
{
    const uint64_t per_us = TIMER_HZ / 1000000;
    timer.period_ticks = format == TICK_FORMAT       ? value
                         : format == MICROSEC_FORMAT ? value * per_us / timer.prescaler
                                                     : TIMER_HZ / timer.prescaler / value;
}
void HardwareTimer::setCount(uint32_t, TimerFormat_t) {}
uint32_t HardwareTimer::getCount(TimerFormat_t)
{
    demand(timer.runs, "a timer is read that stands still");
    return static_cast<uint32_t>(timer.ticks() % timer.period_ticks);
}
uint32_t HardwareTimer::getTimerClkFreq() { return TIMER_HZ; }
void HardwareTimer::attachInterrupt(std::function<void()> callback) { timer.callback = callback; }

void STM32LowPower::begin() { low_power_is_ready = true; }
void STM32LowPower::deepSleep(uint32_t milliseconds)
{
    demand(low_power_is_ready, "deep sleep was not begun");
    demand(world.baud == 0, "the serial line would keep the processor awake");
    // As version 1.5.0: the tick ends it early where a debugger was, and it waits afterwards.
    const uint32_t slept = tick_runs ? 1 : milliseconds;
    world.deep_sleep_us += uint64_t{1000} * slept;
    delay(slept);
    HAL_Delay(10);
}

void IWatchdogClass::begin(uint32_t timeout_us)
{
    watchdog.timeout_us = timeout_us;
    reload();
}
void IWatchdogClass::reload() { watchdog.reloaded_us = world.now_us; }
