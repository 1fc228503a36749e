/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_receive.h"

#include <math.h>

#include "retrolidar_wire.h"

enum { ZONE_BYTES = 11 };

int32_t rl_cobs_decode(const uint8_t *encoded, size_t length, uint8_t *data)
{
    int32_t written = 0;
    size_t at = 0;
    while (at < length) {
        uint8_t code = encoded[at];
        if (code == 0 || code > length - at) {
            return -1 - (int32_t)at;
        }
        for (size_t end = at++ + code; at < end; at++) {
            if (encoded[at] == 0) {
                return -1 - (int32_t)at;
            }
            data[written++] = encoded[at];
        }
        if (code < 0xFF && at < length) {
            data[written++] = 0;
        }
    }
    return written;
}

static uint32_t get(const uint8_t *bytes, uint8_t count)
{
    uint32_t value = 0;
    while (count-- > 0) {
        value = value << 8 | bytes[count];
    }
    return value;
}

void rl_wire_zones(const uint8_t *zones, uint32_t rows, float *distance, float *signal,
                   float *ambient, uint8_t *status)
{
    for (uint32_t i = 0; i < rows * rows; i++, zones += ZONE_BYTES) {
        uint32_t zone = i / rows * rows + (rows - 1 - i % rows); /* zone 0 is at the top right */
        int16_t quarter_mm = (int16_t)(uint16_t)get(zones, 2);
        signal[zone] = (float)(get(zones + 2, 4) / 2048.0);
        ambient[zone] = (float)(get(zones + 6, 4) / 2048.0);
        status[zone] = zones[10];
        distance[zone] = status[zone] == RL_STATUS_NO_TARGET ? NAN : (float)(quarter_mm / 4000.0);
    }
}
