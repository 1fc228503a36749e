// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "Arduino.h"

class SPIClass {
public:
    SPIClass(uint32_t mosi, uint32_t miso, uint32_t clock);
    void begin();
};
