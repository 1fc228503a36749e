/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What a reader puts on the serial line, a frame or who it is: protocol 1, all little-endian, with
 * a CRC-16/CCITT-FALSE, COBS-encoded (Cheshire and Baker 1999) and ended by a zero.
 */
#ifndef RETROLIDAR_WIRE_H
#define RETROLIDAR_WIRE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

enum { RL_KIND_FRAME = 1, RL_KIND_IDENTITY = 2, RL_SERIAL_BYTES = 12, RL_STATUS_NO_TARGET = 255 };

/* One zone, in the sensor's raw units. */
struct rl_zone {
    int16_t distance; /* [mm/4] */
    uint32_t signal;  /* [kcps/SPAD/2048] */
    uint32_t ambient; /* the same */
    uint8_t status;
};

struct rl_frame {
    uint32_t sequence;
    uint64_t sensor_time_us;     /* middle of the exposure */
    uint8_t rows;                /* 4 or 8, and as many columns */
    const struct rl_zone *zones; /* in the sensor's own order */
};

/* Who a reader is, and whether its sensor ranges. */
struct rl_identity {
    uint8_t version[3]; /* of the firmware: major, minor, patch */
    bool is_ranging;
    uint8_t serial[RL_SERIAL_BYTES]; /* of the processor; a shorter one begins with zeros */
};

/* Bytes that an identity takes on the line. */
enum { RL_IDENTITY_BYTES = 1 + 3 + 1 + RL_SERIAL_BYTES + 2 + 2 };

/* Bytes that a frame of so many zones may take on the line: header, zones and checksum, one byte in
 * 254 and one more for COBS, and the zero at the end.
 */
#define RL_WIRE_CONTENT(zones) (15 + 11 * (zones) + 2)
#define RL_WIRE_BYTES(zones) (RL_WIRE_CONTENT(zones) + RL_WIRE_CONTENT(zones) / 254 + 2)

/* What the sensor's driver says of a zone, as a zone of a frame. In its raw format the driver
 * leaves the status and the values of an earlier target where there is none.
 */
struct rl_zone rl_zone_of(uint8_t targets, int16_t distance, uint32_t signal, uint32_t ambient,
                          uint8_t status);

/* Write a frame; return its bytes on the line, or 0 if the shape is none of the sensor's or
 * capacity is less than RL_WIRE_BYTES.
 */
size_t rl_wire_encode(const struct rl_frame *frame, uint8_t *line, size_t capacity);

/* Write an identity; return its bytes on the line, always RL_IDENTITY_BYTES. */
size_t rl_wire_encode_identity(const struct rl_identity *identity, uint8_t *line);

/* Extend a counter of 32 bits that wraps, read more often than it wraps, to one that does not. */
uint64_t rl_extend_us(uint64_t last_us, uint32_t counter_us);

#ifdef __cplusplus
}
#endif

#endif
