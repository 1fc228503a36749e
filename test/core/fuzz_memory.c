/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * The memory of detectors: not to be taken once they are created, or each array for itself.
 */
#include "fuzz.h"

#include "retrolidar_detector_state.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
        static const char text[] = "memory is taken after a detector was created\n";
        fwrite(text, 1, sizeof text - 1, stderr);
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

void open_heap(void)
{
    used = 0;
    closed = 0;
}

void close_heap(void)
{
    closed = 1;
}
#else
void open_heap(void)
{
}

void close_heap(void)
{
}
#endif

#ifdef ISOLATED
static void *blocks[96];
static int block_count;

/* Take the place of an array by a block of its own, with what it holds. */
static void *alone(const void *array, size_t bytes)
{
    void *block = malloc(bytes);
    blocks[block_count++] = block;
    return memcpy(block, array, bytes);
}

#define ALONE(array, count) ((array) = alone((array), (count) * sizeof *(array)))

void isolate(struct rl_detector *detector)
{
    struct rl_samples *samples = &detector->samples;
    struct rl_view *view = &detector->search.view;
    struct rl_window *window = &detector->window;
    const size_t capacity = (size_t)samples->capacity, sources = (size_t)samples->sources;
    const size_t zones = (size_t)samples->zones, kept = (size_t)samples->kept;
    const size_t lanes = (kept + 1) * RL_MOST_LANES;
    block_count = 0;
    ALONE(samples->sum, sources);
    ALONE(samples->square, sources);
    ALONE(samples->begin_s, capacity);
    ALONE(samples->end_s, capacity);
    ALONE(samples->signal, capacity * sources);
    ALONE(samples->valid, capacity * sources);
    ALONE(samples->distance, capacity * zones);
    ALONE(samples->stamp_ns, capacity);
    ALONE(view->light, lanes);
    ALONE(view->total, lanes);
    ALONE(view->power, lanes);
    ALONE(view->valid, lanes);
    ALONE(view->begin, kept + 1);
    ALONE(view->rate, kept + 1);
    ALONE(view->pivot, (kept + 1) * RL_LANES);
    for (int i = 0; i < RL_LANES; i++) {
        ALONE(view->room[i].signal, kept);
        ALONE(view->room[i].valid, kept);
    }
    for (int i = 0; i < RL_MOST_ZONES_TOGETHER; i++) {
        struct rl_whitened *whitened = &window->whitened[i];
        ALONE(whitened->row, kept);
        ALONE(whitened->gain, kept);
        ALONE(whitened->scale, kept);
        ALONE(whitened->signal, kept);
    }
    ALONE(window->light, kept);
    ALONE(window->room.signal, kept);
    ALONE(window->room.valid, kept);
    ALONE(window->valid, kept);
    ALONE(detector->shares.taken, kept * RL_MOST_ZONES_TOGETHER);
    ALONE(detector->shares.light, kept);
}

void give_back(void)
{
    while (block_count > 0) {
        free(blocks[--block_count]);
    }
}
#else
void isolate(struct rl_detector *detector)
{
    (void)detector;
}

void give_back(void)
{
}
#endif
