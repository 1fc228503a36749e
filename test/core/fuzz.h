/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * The parts of the fuzz program.
 */
#ifndef RETROLIDAR_FUZZ_H
#define RETROLIDAR_FUZZ_H

#include "retrolidar_placement.h"

enum { KEPT = 1100, ZONES = 64, LEAST_ID = 1, MOST_ID = 4094 };

extern uint64_t state;     /* of the random numbers */
extern uint16_t ids[4096]; /* that are registered; none = any may come */
extern int id_count;

uint64_t any(void);
int below(int count);
double share(void);

/* Of any order of magnitude in between. */
double scaled(double least, double most);

enum { GARBAGE, LEVEL, PACKET, LONE_PACKET, TWO_PACKETS, PREAMBLES, RANDOM_BITS, KINDS };

/* What a zone sees: garbage, or something that blinks like a packet. */
struct zone {
    int kind;
    uint32_t bits, second; /* of two packets */
    int cycle, second_cycle; /* bits after which each begins again */
    double bright, dark, noise, start_s, bit_s, distance;
    double second_share; /* of the other packet's light */
    double sway_s, phase; /* of the light; 0 = steady */
};

struct zone any_zone(double bit_s);

/* Another zone that sees the same, of a gain of its own that changes as the marker moves. */
struct zone beside(const struct zone *zone);

float light(const struct zone *zone, double time_s);
float garbage(void);
uint8_t any_status(void);

/* How stamps go on, for a while. */
int any_stamp_kind(void);
int64_t next_stamp(int64_t stamp_ns, int kind, int64_t period_ns);

void expect(int holds, const char *what);
#define EXPECT(condition) expect((condition), #condition)

void check(const struct rl_detector *detector, const struct rl_settings *settings);

/* Ask of every reading what the package asks. */
void ask(struct rl_detector *detector);

/* Give each array of a detector a block of its own, where a sanitizer sees a sample too many; free
 * them all.
 */
void isolate(struct rl_detector *detector);
void give_back(void);

#endif
