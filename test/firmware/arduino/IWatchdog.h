// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "Arduino.h"

class IWatchdogClass {
public:
    void begin(uint32_t timeout_us);
    void reload();
};
extern IWatchdogClass IWatchdog;
