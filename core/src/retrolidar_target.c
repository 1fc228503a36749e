/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_target.h"

#include <math.h>
#include <stddef.h>

/* Distances further apart are two targets; the sensor parts them from 0.6 m on (ST UM3109). */
static const float GAP_M = 0.5f;
/* A nearer target in a smaller share of the frames is passing by. */
static const double PASSING = 0.2;

/* Heapsort: unlike qsort of some C libraries, it takes no memory. */
static void sort(float *values, int count)
{
    for (int root = count / 2 - 1, last = count - 1; last > 0; root--) {
        if (root < 0) {
            const float most = values[0];
            values[0] = values[last];
            values[last--] = most;
        }
        int parent = root < 0 ? 0 : root, child = 2 * parent + 1;
        const float value = values[parent];
        for (; child <= last; child = 2 * parent + 1) {
            child += child < last && values[child + 1] > values[child];
            if (values[child] <= value) {
                break;
            }
            values[parent] = values[child];
            parent = child;
        }
        values[parent] = value;
    }
}

static void part(const float *distance, int stride, int rows, float *signal, uint8_t *valid,
                 float *ordered)
{
    int count = 0;
    for (int row = 0; row < rows; row++) {
        if (!isnan(distance[(size_t)row * (size_t)stride])) {
            ordered[count++] = distance[(size_t)row * (size_t)stride];
        }
    }
    sort(ordered, count);
    const float nearer = ordered[count / 2] - GAP_M;
    int passing = 0;
    while (ordered[passing] < nearer) {
        passing++;
    }
    if (passing >= PASSING * count) {
        passing = 0;
    }
    float widest = 0.0f, middle = 0.0f;
    for (int i = passing + 1; i < count; i++) {
        if (ordered[i] - ordered[i - 1] > widest) {
            widest = ordered[i] - ordered[i - 1];
            middle = (ordered[i] + ordered[i - 1]) / 2;
        }
    }
    double sum[2] = {0.0, 0.0}, seen[2] = {1e-9, 1e-9};
    for (int row = 0; row < rows; row++) {
        const float d = distance[(size_t)row * (size_t)stride];
        if (isnan(d) || !valid[row]) {
            continue;
        }
        if (passing > 0 && d < nearer) {
            valid[row] = 0;
            signal[row] = row > 0 ? signal[row - 1] : 0.0f;
            continue;
        }
        sum[d > middle] += (double)signal[row];
        seen[d > middle] += 1.0;
    }
    if (widest < GAP_M) {
        return;
    }
    const int other = sum[1] / seen[1] < sum[0] / seen[0];
    for (int row = 0; row < rows; row++) {
        const float d = distance[(size_t)row * (size_t)stride];
        if (!isnan(d) && valid[row] && (d > middle) == other) {
            signal[row] = 0.0f;
        }
    }
}

void rl_target_column(const struct rl_samples *samples, int source, int first, int rows,
                      float *signal, uint8_t *valid, float *scratch)
{
    const size_t width = (size_t)samples->width, from = (size_t)first;
    for (int row = 0; row < rows; row++) {
        signal[row] = samples->signal[(from + (size_t)row) * width + (size_t)source];
        valid[row] = samples->valid[(from + (size_t)row) * width + (size_t)source];
    }
    if (source >= samples->zones) {
        return;
    }
    const float *distance = samples->distance + from * (size_t)samples->zones + source;
    float nearest = INFINITY, farthest = -INFINITY;
    for (int row = 0; row < rows; row++) {
        const float d = distance[(size_t)row * (size_t)samples->zones];
        nearest = fminf(nearest, d);
        farthest = fmaxf(farthest, d);
    }
    if (farthest - nearest > GAP_M) {
        part(distance, samples->zones, rows, signal, valid, scratch);
    }
}
