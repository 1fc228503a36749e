/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * What comes from a sensor, or from none.
 */
#include "fuzz.h"

#include "retrolidar_packet.h"

#include <math.h>
#include <string.h>

uint64_t state;

uint64_t any(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state * 0x2545F4914F6CDD1Du;
}

int below(int count)
{
    return (int)((any() >> 33) % (uint64_t)count);
}

double share(void)
{
    return (double)(any() >> 11) / 9007199254740992.0;
}

double scaled(double least, double most)
{
    return least * pow(most / least, share());
}

static uint32_t any_packet(void)
{
    return rl_packet(id_count > 0 && below(4) ? ids[below(id_count)] : (uint16_t)below(4096));
}

struct zone any_zone(double bit_s)
{
    static const double CLOCKS[] = {1.0, 1.0, 0.97, 1.03, 0.5};
    struct zone zone = {.kind = below(KINDS), .cycle = RL_PACKET_BITS,
                        .second_cycle = RL_PACKET_BITS};
    zone.bits = any_packet();
    if (zone.kind == PREAMBLES) {
        zone.bits = 0x55555555u >> below(2) & 0x7FFFFFFFu;
    } else if (zone.kind == RANDOM_BITS) {
        zone.bits = (uint32_t)(any() >> 33);
    } else if (zone.kind == LONE_PACKET) {
        zone.cycle = 40 + below(60);
    } else if (zone.kind == TWO_PACKETS) {
        zone.second = any_packet();
        zone.second_cycle = below(2) ? RL_PACKET_BITS : 50;
        zone.second_share = scaled(0.05, 1.0);
    }
    zone.bright = scaled(1e-3, 4e6);
    zone.dark = below(2) ? 0.0 : zone.bright * share();
    zone.noise = zone.bright * (below(3) ? scaled(1e-9, 1.0) : 0.0);
    zone.start_s = share() * 62.0 * bit_s;
    zone.bit_s = bit_s * CLOCKS[below(5)];
    zone.distance = scaled(1e-3, 20.0);
    zone.sway_s = below(3) ? 0.0 : bit_s * scaled(10.0, 1000.0);
    return zone;
}

struct zone beside(const struct zone *zone)
{
    struct zone other = *zone;
    other.phase = 6.3 * share();
    other.bright *= scaled(0.1, 1.0);
    return other;
}

float garbage(void)
{
    static const float STRANGE[] = {NAN,   INFINITY, -INFINITY, 0.0f,     -0.0f, 1e-40f,
                                    3e38f, -3e38f,   2097152.0f, 2097153.0f, 8.192f, -1.0f};
    uint32_t bits;
    float value;
    switch (below(3)) {
    case 0:
        return STRANGE[below((int)(sizeof STRANGE / sizeof *STRANGE))];
    case 1:
        return (float)scaled(1e-6, 1e9);
    default:
        bits = (uint32_t)any();
        memcpy(&value, &bits, sizeof value);
        return value;
    }
}

uint8_t any_status(void)
{
    static const uint8_t USUAL[] = {5, 5, 5, 5, 6, 9, 10, 255, 8, 0};
    return below(20) ? USUAL[below((int)sizeof USUAL)] : (uint8_t)below(256);
}

static int is_dark(uint32_t bits, int cycle, double since_bits)
{
    const int bit = (int)(since_bits - cycle * floor(since_bits / cycle));
    return bit < RL_PACKET_BITS && (bits & rl_packet_bit(bit)) != 0;
}

float light(const struct zone *zone, double time_s)
{
    const double since = (time_s - zone->start_s) / zone->bit_s;
    const double swayed = 0.5 + 0.5 * sin(6.3 * time_s / zone->sway_s + zone->phase);
    const double sway = zone->sway_s > 0.0 ? swayed : 1.0;
    const int dark = zone->kind != LEVEL && is_dark(zone->bits, zone->cycle, since);
    const int second_dark = is_dark(zone->second, zone->second_cycle, since * 1.003 + 7.3);
    const double first = dark ? zone->dark : zone->bright;
    const double second = second_dark ? 0.0 : zone->second_share * zone->bright;
    return (float)(sway * (first + second) + zone->noise * (share() - 0.5));
}

/* How stamps go on, for a while. */
enum { STANDING, JITTERING, LOSING, JUMPING, FALLING_BACK, REGULAR, STAMP_KINDS };

int any_stamp_kind(void)
{
    return below(2) ? REGULAR : below(STAMP_KINDS);
}

int64_t next_stamp(int64_t stamp_ns, int kind, int64_t period_ns)
{
    static const int64_t EXTREME[] = {INT64_MIN, INT64_MAX, 0, -1, INT64_MIN + 1, INT64_MAX - 1};
    uint64_t step = (uint64_t)period_ns;
    switch (below(200) ? kind : below(STAMP_KINDS)) {
    case STANDING:
        step = below(4) ? 1 : 0;
        break;
    case JITTERING:
        step = (uint64_t)((double)period_ns * (0.5 + share()));
        break;
    case LOSING:
        step *= (uint64_t)(1 + (below(30) ? 0 : below(40)));
        break;
    case JUMPING:
        if (below(100) == 0) {
            return EXTREME[below(6)];
        }
        break;
    case FALLING_BACK:
        if (below(100) == 0) {
            step = 0 - step;
        }
        break;
    default:
        break;
    }
    return (int64_t)((uint64_t)stamp_ns + step);
}
