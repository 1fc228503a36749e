// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstring>

#include "Arduino.h"

struct EEPROMClass {
    uint8_t bytes[64];

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
extern EEPROMClass EEPROM;
