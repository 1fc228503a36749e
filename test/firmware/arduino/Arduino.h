// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// What the sketches use of STM32duino's core, declared as there, on a machine whose time passes
// only while a sketch waits.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>

enum { LOW, HIGH };
enum { INPUT, OUTPUT, INPUT_PULLUP, INPUT_PULLDOWN };
enum { CHANGE = 1, FALLING, RISING };
enum : uint32_t { D2 = 2, D3, D4, D5, D9 = 9, D10, D11, LED_BUILTIN = 13, A2 = 16, A3 };

void pinMode(uint32_t pin, uint32_t mode);
void digitalWrite(uint32_t pin, uint32_t value);
int digitalRead(uint32_t pin);
uint32_t digitalPinToInterrupt(uint32_t pin);
void attachInterrupt(uint32_t pin, std::function<void()> callback, uint32_t mode);
void noInterrupts();
void interrupts();
void delay(uint32_t milliseconds);
void delayMicroseconds(uint32_t microseconds);
uint32_t millis();
void __WFI();
extern "C" {
void HAL_Delay(uint32_t milliseconds);
void HAL_SuspendTick();
void HAL_ResumeTick();
uint32_t HAL_GetUIDw0();
uint32_t HAL_GetUIDw1();
uint32_t HAL_GetUIDw2();
}
[[noreturn]] void NVIC_SystemReset();

class HardwareSerial {
public:
    void begin(unsigned long baud);
    void end();
    void flush();
    int available();
    int read();
    int availableForWrite();
    size_t write(uint8_t byte);
    size_t write(const uint8_t *bytes, size_t count);
    size_t print(const char *text);
    size_t print(int number);
};
extern HardwareSerial Serial;

struct TIM_TypeDef;
extern TIM_TypeDef *const TIM2;
extern TIM_TypeDef *const TIM5;
enum TimerFormat_t { TICK_FORMAT, MICROSEC_FORMAT, HERTZ_FORMAT };

class HardwareTimer {
public:
    explicit HardwareTimer(TIM_TypeDef *instance);
    void pause();
    void resume();
    void setPrescaleFactor(uint32_t prescaler);
    void setOverflow(uint32_t value, TimerFormat_t format = TICK_FORMAT);
    void setCount(uint32_t value, TimerFormat_t format = TICK_FORMAT);
    uint32_t getCount(TimerFormat_t format = TICK_FORMAT);
    uint32_t getTimerClkFreq();
    void attachInterrupt(std::function<void()> callback);
};
