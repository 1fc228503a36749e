/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 *
 * The memory of detectors, each array for itself.
 */
#include "fuzz.h"

#include "retrolidar_detector_state.h"

#include <stdlib.h>
#include <string.h>

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
