/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * Gives frames of garbage to detectors of any settings, and looks at all that they say.
 *
 * fuzz SEED DETECTORS FRAMES
 *
 * Of every detector it prints what came of it. With -DISOLATED it gives every array of a detector
 * a block of memory of its own, where a sanitizer sees a sample too many. With -DNO_HEAP nothing may
 * be allocated once a detector is created.
 */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "retrolidar_detector_state.h"

enum { KEPT = 1100, BLOCK = 64, ZONES = 64, LEAST_ID = 1, MOST_ID = 4094 };

static uint64_t state;

static uint64_t any(void)
{
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state * 0x2545F4914F6CDD1Du;
}

static int below(int count)
{
    return (int)((any() >> 33) % (uint64_t)count);
}

static double share(void)
{
    return (double)(any() >> 11) / 9007199254740992.0;
}

/* Of any order of magnitude in between. */
static double scaled(double least, double most)
{
    return least * pow(most / least, share());
}

static void expect(int holds, const char *what)
{
    if (!holds) {
        fflush(stdout);
        fprintf(stderr, "not so: %s\n", what);
        exit(1);
    }
}
#define EXPECT(condition) expect((condition), #condition)

#ifdef NO_HEAP
/* In place of those of the C library, for its own functions, too. */
static union {
    char bytes[1 << 26];
    double aligned;
} arena;
static size_t used;
static int closed;

static void *take(size_t bytes)
{
    if (closed) {
        static const char told[] = "memory is taken after a detector was created\n";
        fwrite(told, 1, sizeof told - 1, stderr);
        abort();
    }
    void *memory = arena.bytes + used;
    used += (bytes + 15) / 16 * 16;
    return used <= sizeof arena.bytes ? memory : NULL;
}

void *malloc(size_t bytes)
{
    return take(bytes);
}

void *calloc(size_t count, size_t bytes)
{
    void *memory = take(count * bytes);
    return memory == NULL ? NULL : memset(memory, 0, count * bytes);
}

void *realloc(void *memory, size_t bytes)
{
    void *other = take(bytes);
    return memory == NULL || other == NULL ? other : memcpy(other, memory, bytes);
}

void free(void *memory)
{
    (void)memory;
}
#endif

/* What a zone sees: garbage, or something that blinks like a packet. */
struct zone {
    int kind;
    uint32_t bits, second; /* of two packets */
    int cycle, second_cycle; /* bits after which each begins again */
    double bright, dark, noise, start_s, bit_s, distance;
    double second_share; /* of the other packet's light */
    double sway_s, phase; /* of the light; 0 = steady */
};

enum { GARBAGE, LEVEL, PACKET, LONE_PACKET, TWO_PACKETS, PREAMBLES, RANDOM_BITS, KINDS };

static uint16_t ids[4096]; /* that are registered; none = any may come */
static int id_count;

static uint32_t any_packet(void)
{
    return rl_packet(id_count > 0 && below(4) ? ids[below(id_count)] : (uint16_t)below(4096));
}

static struct zone any_zone(double bit_s)
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

/* Another zone that sees the same, of a gain of its own that changes as the marker moves. */
static struct zone beside(const struct zone *zone)
{
    struct zone other = *zone;
    other.phase = 6.3 * share();
    other.bright *= scaled(0.1, 1.0);
    return other;
}

static float garbage(void)
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

static uint8_t any_status(void)
{
    static const uint8_t USUAL[] = {5, 5, 5, 5, 6, 9, 10, 255, 8, 0};
    return below(20) ? USUAL[below((int)sizeof USUAL)] : (uint8_t)below(256);
}

static int is_dark(uint32_t bits, int cycle, double since_bits)
{
    const int bit = (int)(since_bits - cycle * floor(since_bits / cycle));
    return bit < RL_PACKET_BITS && (bits & rl_packet_bit(bit)) != 0;
}

static float light(const struct zone *zone, double time_s)
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

static int any_kind(void)
{
    return below(2) ? REGULAR : below(STAMP_KINDS);
}

static int64_t next_stamp(int64_t stamp_ns, int kind, int64_t period_ns)
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

static void check(const struct rl_detector *detector, const struct rl_settings *settings)
{
    const int zones = settings->rows * settings->columns;
    const int sources = zones + (settings->rows - 1) * (settings->columns - 1) + 1;
    const struct rl_counts counts = rl_detector_counts(detector);
    const struct rl_held held = rl_detector_held(detector);
    uint64_t refused = 0;
    for (int reason = 0; reason < RL_REASONS; reason++) {
        refused += counts.refused[reason];
    }
    EXPECT(counts.accepted + refused == counts.candidates);
    EXPECT(held.zones == zones && held.width >= sources);
    EXPECT(held.first >= 0 && held.first <= held.count && held.count <= 4 * KEPT);
    EXPECT(held.noise_scale >= 1.0 / 16 && held.noise_scale <= 16.0);
    EXPECT(held.period_s > 0.0 && isfinite(held.period_s));
    for (int row = held.first; row < held.count; row++) {
        EXPECT(isfinite(held.begin_s[row]) && held.begin_s[row] < held.end_s[row]);
        EXPECT(row == held.first || held.end_s[row - 1] <= held.begin_s[row]);
        for (int source = 0; source < sources; source++) {
            EXPECT(isfinite(held.signal[(size_t)row * (size_t)held.width + (size_t)source]));
            EXPECT(held.signal[(size_t)row * (size_t)held.width + (size_t)source] >= 0.0f);
        }
        for (int zone = 0; zone < zones; zone++) {
            const float distance = held.distance[(size_t)row * (size_t)zones + (size_t)zone];
            EXPECT(isnan(distance) || (distance > 0.0f && distance < 8.192f));
        }
    }
    for (int i = 0; i < rl_detector_candidates(detector); i++) {
        const struct rl_candidate one = rl_detector_candidate(detector, i);
        EXPECT(one.reason >= 0 && one.reason <= RL_REASONS);
        EXPECT(one.source >= 0 && one.source < sources);
        EXPECT(one.packets >= 1 && one.packets <= settings->max_packets);
        EXPECT(isfinite(one.start_s) && isfinite(one.bit_s));
        EXPECT(fabs(one.bit_s / settings->bit_s - 1.0) < 0.05);
        EXPECT(isfinite(one.evidence) && isfinite(one.margin));
        EXPECT(isfinite(one.word) || one.word == -INFINITY);
    }
    for (int i = 0; i < rl_detector_readings(detector); i++) {
        const struct rl_reading one = rl_detector_reading(detector, i);
        int known = id_count == 0;
        for (int j = 0; j < id_count; j++) {
            known |= ids[j] == one.id;
        }
        EXPECT(known && one.id >= LEAST_ID && one.id <= MOST_ID);
        EXPECT(one.packets >= 1 && one.packets <= settings->max_packets);
        EXPECT(isfinite(one.start_s) && fabs(one.bit_s / settings->bit_s - 1.0) < 0.05);
        EXPECT(one.brightening_s > 0.0 && one.brightening_s < 0.03);
        EXPECT(isfinite(one.begin_s) && isfinite(one.end_s) && one.begin_s < one.end_s);
        EXPECT(one.evidence >= settings->evidence && isfinite(one.evidence));
        EXPECT(isfinite(one.margin));
        EXPECT(one.zones >= 1 && one.zones <= 16);
        for (int j = 0; j < one.zones; j++) {
            EXPECT(one.zone[j] >= 0 && one.zone[j] < zones);
        }
    }
}

/* Ask of every reading what the package asks. */
static void ask(struct rl_detector *detector)
{
    static double light_of[4 * KEPT];
    static float signal[4 * KEPT * ZONES];
    static uint8_t valid[4 * KEPT * ZONES];
    const struct rl_held held = rl_detector_held(detector);
    for (int i = 0; i < rl_detector_readings(detector); i++) {
        const struct rl_reading one = rl_detector_reading(detector, i);
        int first = 0, last = 0;
        while (first < held.count && held.end_s[first] <= one.begin_s) {
            first++;
        }
        while (last < held.count && held.begin_s[last] < one.end_s) {
            last++;
        }
        EXPECT(first < last);
        rl_detector_light(detector, &one, first, last - first, light_of);
        rl_detector_columns(detector, first, last - first, signal, valid);
        for (int row = 0; row < last - first; row++) {
            EXPECT(light_of[row] > -1e-6 && light_of[row] < 1.0 + 1e-6);
            for (int zone = 0; zone < held.zones; zone++) {
                EXPECT(isfinite(signal[row * held.zones + zone]));
            }
        }
    }
}

static struct rl_settings any_settings(void)
{
    const int rows = below(3) ? 4 : 8;
    return (struct rl_settings){
        .rows = rows,
        .columns = rows,
        .max_packets = 1 + below(8),
        .kept = KEPT,
        .bit_s = below(3) ? 0.042 : scaled(0.002, 10.0),
        .noise_floor = below(2) ? 4.6 : scaled(1e-12, 1e12),
        .noise_slope = below(2) ? 0.22 : below(4) ? scaled(1e-12, 1e12) : 0.0,
        .noise_ambient = below(2) ? 0.22 : below(4) ? scaled(1e-12, 1e12) : 0.0,
        /* Little is demanded, so that much is read. */
        .evidence = below(2) ? 28.0 : 40.0 * share(),
        .wandering = below(2) ? 6.0 : 0.0,
        .word = below(2) ? 8.0 : 1e3,
        .margin = below(2) ? 7.0 : -1e3,
        .margin_of_more = below(2) ? 9.0 : -1e3,
    };
}

static void register_ids(void)
{
    const int every = below(3) == 0 ? 1 + below(3) : 1 + below(4094);
    id_count = 0;
    for (int id = LEAST_ID + below(every); id <= MOST_ID && every < 4000; id += every) {
        ids[id_count++] = (uint16_t)id;
    }
}

#ifdef ISOLATED
static void *blocks[64];
static int block_count;

/* Take the place of an array by a block of its own, with what it holds. */
static void *alone(const void *array, size_t bytes)
{
    void *block = malloc(bytes);
    blocks[block_count++] = block;
    return memcpy(block, array, bytes);
}

#define ALONE(array, count) ((array) = alone((array), (count) * sizeof *(array)))

static void isolate(struct rl_detector *detector)
{
    struct rl_samples *samples = &detector->samples;
    struct rl_view *view = &detector->search.view;
    struct rl_window *window = &detector->window;
    const size_t capacity = (size_t)samples->capacity, width = (size_t)samples->width;
    const size_t zones = (size_t)samples->zones, kept = (size_t)samples->kept;
    const size_t lanes = (kept + 1) * RL_MOST_SOURCES;
    block_count = 0;
    ALONE(samples->sum, width);
    ALONE(samples->square, width);
    ALONE(samples->begin_s, capacity);
    ALONE(samples->end_s, capacity);
    ALONE(samples->signal, capacity * width);
    ALONE(samples->valid, capacity * width);
    ALONE(samples->distance, capacity * zones);
    ALONE(samples->stamp_ns, capacity);
    ALONE(view->light, lanes);
    ALONE(view->total, lanes);
    ALONE(view->power, lanes);
    ALONE(view->valid, lanes);
    ALONE(view->begin, kept + 1);
    ALONE(view->rate, kept + 1);
    ALONE(view->signal, kept + 1);
    ALONE(view->scratch, kept + 1);
    ALONE(view->known, kept + 1);
    for (int i = 0; i < RL_MOST_ZONES_TOGETHER; i++) {
        struct rl_whitened *whitened = &window->whitened[i];
        ALONE(whitened->row, kept);
        ALONE(whitened->gain, kept);
        ALONE(whitened->scale, kept);
        ALONE(whitened->signal, kept);
    }
    ALONE(window->light, kept);
    ALONE(window->signal, kept);
    ALONE(window->scratch, kept);
    ALONE(window->valid, kept);
    ALONE(detector->shares.taken, kept * RL_MOST_ZONES_TOGETHER);
    ALONE(detector->shares.light, kept);
}

static void give_back(void)
{
    while (block_count > 0) {
        free(blocks[--block_count]);
    }
}
#endif

static void try_one(int number, int frames)
{
    static int64_t stamp_ns[BLOCK];
    static float signal[BLOCK * ZONES], distance[BLOCK * ZONES], ambient[BLOCK * ZONES];
    static uint8_t status[BLOCK * ZONES];
    const struct rl_settings settings = any_settings();
    const int zones = settings.rows * settings.columns;
    /* Two frames a bit; or so many that a packet just about fits in what is kept; or any. */
    const double bits_a_frame = below(3)   ? 0.5
                                : below(3) ? (double)RL_PACKET_BITS / KEPT * (0.9 + 0.2 * share())
                                           : scaled(0.02, 2.0);
    const int64_t period_ns = 1 + (int64_t)(1e9 * settings.bit_s * bits_a_frame);
    const int garbage_share = below(3) ? 1 + below(100) : 10000;
    const int alike = below(2);
    struct zone zone[ZONES];
    int64_t stamp = below(2) ? 0 : (int64_t)any();
    double time_s = 0.0;
    int kind = any_kind(), read = 0, candidates = 0;
    register_ids();
#ifdef NO_HEAP
    used = 0;
    closed = 0;
#endif
    struct rl_detector *detector = rl_detector_create(&settings, ids, id_count);
    EXPECT(detector != NULL);
#ifdef NO_HEAP
    closed = 1;
#endif
#ifdef ISOLATED
    isolate(detector);
#endif
    for (int i = 0; i < zones; i++) {
        zone[i] = i > 0 && alike && below(8) ? beside(&zone[0]) : any_zone(settings.bit_s);
    }
    for (int done = 0; done < frames;) {
        const int block = 1 + below(BLOCK);
        for (int frame = 0; frame < block; frame++) {
            const int64_t before = stamp;
            stamp = next_stamp(stamp, kind, period_ns);
            if (stamp > before && (uint64_t)stamp - (uint64_t)before < 1u << 31) {
                time_s += (double)(stamp - before) * 1e-9;
            }
            stamp_ns[frame] = stamp;
            for (int i = 0; i < zones; i++) {
                const int at = frame * zones + i;
                const int strange = zone[i].kind == GARBAGE || below(garbage_share) == 0;
                signal[at] = strange ? garbage() : light(&zone[i], time_s);
                distance[at] =
                    strange ? garbage() : (float)(zone[i].distance * (1.0 + 0.1 * share()));
                ambient[at] = strange ? garbage() : 1.0f;
                status[at] = strange ? any_status() : 5;
            }
        }
        for (int taken = 0; taken < block;) {
            const int at = taken * zones;
            const int more =
                rl_detector_push(detector, block - taken, stamp_ns + taken, signal + at,
                                 distance + at, ambient + at, status + at);
            EXPECT(more > 0 && more <= block - taken);
            taken += more;
            read += rl_detector_readings(detector);
            candidates += rl_detector_candidates(detector);
            ask(detector);
        }
        check(detector, &settings);
        done += block;
        if (below(10) == 0) {
            kind = any_kind();
            zone[below(zones)] = any_zone(settings.bit_s);
        }
    }
    printf("%d: %d zones, %d IDs, bits of %g s: %d candidates, %d read\n", number, zones, id_count,
           settings.bit_s, candidates, read);
    rl_detector_destroy(detector);
#ifdef ISOLATED
    give_back();
#endif
}

int main(int count, char **words)
{
    static char buffer[1 << 16]; /* so that none is taken from the heap */
    setvbuf(stdout, buffer, _IOFBF, sizeof buffer);
    EXPECT(count == 4);
    const int first = atoi(words[1]), detectors = atoi(words[2]), frames = atoi(words[3]);
    for (int number = first; number < first + detectors; number++) {
        state = 0x9E3779B97F4A7C15u * (uint64_t)(number + 1);
        try_one(number, frames);
    }
    return 0;
}
