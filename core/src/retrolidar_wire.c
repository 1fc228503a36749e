/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_wire.h"

/* Bytes on their way to the line. */
struct encoder {
    uint8_t *line;
    size_t length;
    size_t code_at; /* where the length of the present COBS block goes */
    uint8_t code;
    uint16_t crc;
};

static void end_block(struct encoder *encoder)
{
    encoder->line[encoder->code_at] = encoder->code;
    encoder->code_at = encoder->length++;
    encoder->code = 1;
}

static void put_cobs(struct encoder *encoder, uint8_t byte)
{
    /* A full block stands for no zero, so another one follows only if there is another byte. */
    if (encoder->code == 0xFF) {
        end_block(encoder);
    }
    if (byte == 0) {
        end_block(encoder);
    } else {
        encoder->line[encoder->length++] = byte;
        encoder->code++;
    }
}

static void put(struct encoder *encoder, uint64_t value, uint8_t bytes)
{
    for (; bytes > 0; bytes--, value >>= 8) {
        uint8_t byte = (uint8_t)value;
        encoder->crc ^= (uint16_t)((uint16_t)byte << 8);
        for (uint8_t bit = 0; bit < 8; bit++) {
            uint16_t carry = (encoder->crc & 0x8000u) ? 0x1021u : 0u;
            encoder->crc = (uint16_t)((uint16_t)(encoder->crc << 1) ^ carry);
        }
        put_cobs(encoder, byte);
    }
}

static size_t end(struct encoder *encoder)
{
    put(encoder, encoder->crc, 2);
    encoder->line[encoder->code_at] = encoder->code;
    encoder->line[encoder->length++] = 0;
    return encoder->length;
}

struct rl_zone rl_zone_of(uint8_t targets, int16_t distance, uint32_t signal, uint32_t ambient,
                          uint8_t status)
{
    struct rl_zone zone = {0, 0, ambient, RL_STATUS_NO_TARGET};
    if (targets > 0) {
        zone.distance = distance;
        zone.signal = signal;
        zone.status = status;
    }
    return zone;
}

size_t rl_wire_encode(const struct rl_frame *frame, uint8_t *line, size_t capacity)
{
    size_t zones = (size_t)frame->rows * frame->rows;
    struct encoder encoder = {line, 1, 0, 1, 0xFFFF};
    if ((frame->rows != 4 && frame->rows != 8) || capacity < RL_WIRE_BYTES(zones)) {
        return 0;
    }
    put(&encoder, RL_KIND_FRAME, 1);
    put(&encoder, frame->sequence, 4);
    put(&encoder, frame->sensor_time_us, 8);
    put(&encoder, frame->rows, 1);
    put(&encoder, frame->rows, 1);
    for (size_t i = 0; i < zones; i++) {
        const struct rl_zone *zone = &frame->zones[i];
        put(&encoder, (uint16_t)zone->distance, 2);
        put(&encoder, zone->signal, 4);
        put(&encoder, zone->ambient, 4);
        put(&encoder, zone->status, 1);
    }
    return end(&encoder);
}

size_t rl_wire_encode_identity(const struct rl_identity *identity, uint8_t *line)
{
    struct encoder encoder = {line, 1, 0, 1, 0xFFFF};
    put(&encoder, RL_KIND_IDENTITY, 1);
    for (uint8_t i = 0; i < 3; i++) {
        put(&encoder, identity->version[i], 1);
    }
    put(&encoder, identity->is_ranging, 1);
    for (uint8_t i = 0; i < RL_SERIAL_BYTES; i++) {
        put(&encoder, identity->serial[i], 1);
    }
    return end(&encoder);
}

uint64_t rl_extend_us(uint64_t last_us, uint32_t counter_us)
{
    return last_us + (uint32_t)(counter_us - (uint32_t)last_us);
}
