// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "Arduino.h"

class STM32LowPower {
public:
    void begin();
    void deepSleep(uint32_t milliseconds);
};
extern STM32LowPower LowPower;
