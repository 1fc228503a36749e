// Copyright 2026 retrolidar_ros contributors
// SPDX-License-Identifier: Apache-2.0
//
// What the reader uses of STM32duino's VL53L8CX, declared as there for the flags of its build.
#pragma once

#include "SPI.h"

#define VL53L8CX_NB_TARGET_PER_ZONE 1U
#define VL53L8CX_RESOLUTION_8X8 ((uint8_t)64U)
#define VL53L8CX_RANGING_MODE_CONTINUOUS ((uint8_t)1U)
#define VL53L8CX_TARGET_ORDER_STRONGEST ((uint8_t)2U)
#define VL53L8CX_STATUS_OK ((uint8_t)0U)

struct VL53L8CX_ResultsData {
    int8_t silicon_temp_degc;
    uint32_t ambient_per_spad[VL53L8CX_RESOLUTION_8X8];
    uint8_t nb_target_detected[VL53L8CX_RESOLUTION_8X8];
    uint32_t signal_per_spad[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
    int16_t distance_mm[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
    uint8_t target_status[VL53L8CX_RESOLUTION_8X8 * VL53L8CX_NB_TARGET_PER_ZONE];
};

class VL53L8CX {
public:
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
