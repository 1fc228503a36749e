// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#include "arduino_host.h"

#include <cstring>

#include "EEPROM.h"
#include "STM32LowPower.h"

World world;
HardwareSerial Serial;
EEPROMClass EEPROM = {};
STM32LowPower LowPower;
TIM_TypeDef *const TIM2 = nullptr;
TIM_TypeDef *const TIM5 = nullptr;

// A sketch has one timer.
static struct {
    bool runs;
    uint32_t period_us;
    uint64_t next_us;
    std::function<void()> callback;
} timer;
static uint32_t levels[32];

void World::pass(uint64_t microseconds)
{
    const uint64_t end_us = now_us + microseconds;
    while (timer.runs && timer.callback && timer.next_us <= end_us) {
        now_us = timer.next_us;
        timer.next_us += timer.period_us;
        timer.callback();
    }
    now_us = end_us;
}

void pinMode(uint32_t, uint32_t) {}
void digitalWrite(uint32_t pin, uint32_t value)
{
    levels[pin] = value;
    world.on_pin(pin, value);
}
int digitalRead(uint32_t pin)
{
    return pin == LED_BUILTIN ? static_cast<int>(levels[pin]) : world.level(pin);
}
uint32_t digitalPinToInterrupt(uint32_t pin) { return pin; }
void attachInterrupt(uint32_t, std::function<void()> callback, uint32_t)
{
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
    world.waited_us += timer.next_us - world.now_us;
    world.pass(timer.next_us - world.now_us);
}

void HardwareSerial::begin(unsigned long) {}
void HardwareSerial::end() {}
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
    timer.next_us = world.now_us + timer.period_us;
}
void HardwareTimer::setPrescaleFactor(uint32_t) {}
void HardwareTimer::setOverflow(uint32_t value, TimerFormat_t) { timer.period_us = value; }
void HardwareTimer::setCount(uint32_t, TimerFormat_t) {}
uint32_t HardwareTimer::getCount(TimerFormat_t) { return static_cast<uint32_t>(world.now_us); }
uint32_t HardwareTimer::getTimerClkFreq() { return 84000000; }
void HardwareTimer::attachInterrupt(std::function<void()> callback) { timer.callback = callback; }

void STM32LowPower::begin() {}
void STM32LowPower::deepSleep(uint32_t milliseconds)
{
    world.deep_sleep_us += uint64_t{1000} * milliseconds;
    delay(milliseconds);
}
