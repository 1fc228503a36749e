/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_window.h"

#include <math.h>
#include <string.h>

/* A fit may claim no less than this share of the sensor's noise. */
static const double MIN_NOISE = 0.5;

void rl_window_start(struct rl_window *window, const struct rl_samples *samples,
                     struct rl_memory *memory)
{
    memset(window, 0, sizeof *window);
    window->samples = samples;
    rl_whitened_start(&window->whitened, samples->kept, memory);
    window->light = rl_take(memory, samples->kept, sizeof(double));
    window->part = rl_take(memory, samples->kept, sizeof(double));
    window->on_knot = rl_take(memory, samples->kept, sizeof(double));
    rl_room_start(&window->room, samples->kept, memory);
}

static void lay(const struct rl_window *window, const struct rl_transmission *transmission,
                double *light)
{
    rl_template(transmission, window->begin_s, window->end_s, window->rows, light);
}

/* Make a train that was read an interferer if it explains what it costs: its light, or (`changes`)
 * by how much that is more as its gain changes. Return whether it does.
 */
static bool add_train(struct rl_window *window, const struct rl_packet_train *train, bool changes)
{
    struct rl_whitened *whitened = &window->whitened;
    double *light = window->light;
    rl_train_light(train, window->begin_s, window->end_s, window->rows, light);
    if (changes) {
        double gain[RL_KNOTS];
        rl_fit_knots(whitened, light, window->rows, true, window->on_knot, gain);
        for (int row = 0; row < window->rows; row++) {
            light[row] *= rl_gain_profile_at(gain, row, window->rows);
        }
    }
    const struct rl_gain fit = rl_fit_gain(whitened, light, true);
    /* Seldom, a zone sees less while its neighbour sees more, by what the sensor does against stray
     * light.
     */
    const double surprise = !changes && fit.gain < 0.0 ? RL_COST_OF_CHANCE : 0.0;
    const double price = surprise + (changes ? rl_price_of_profile() : RL_COST_OF_GAIN);
    if (fit.log_likelihood <= whitened->null + price) {
        return false;
    }
    rl_add_interferer(whitened, light);
    return true;
}

/* All trains are tried with steady gains first, as one that is still left out may look like a gain
 * of another one that changes.
 */
static void add_interference(struct rl_window *window)
{
    const struct rl_interference *interference = &window->interference;
    bool is_seen[RL_MAX_TRAINS] = {false};
    for (int changes = 0; changes < 2; changes++) {
        for (int i = 0; i < interference->count; i++) {
            if ((!changes || is_seen[i]) && window->whitened.interferers < RL_MAX_INTERFERERS) {
                is_seen[i] = add_train(window, &interference->train[i], changes);
            }
        }
    }
}

/* Whiten the samples of one channel, and choose what interferes. */
static void whiten(struct rl_window *window)
{
    const struct rl_samples *samples = window->samples;
    window->column = rl_target_column(samples, window->channel, window->first, window->rows,
                                      window->is_dimmer, &window->room);
    const double noise =
        rl_noise_variance(samples, window->channel, rl_mean(window->column.signal, window->rows));
    rl_whiten(&window->whitened, window->column.signal, window->column.valid, window->begin_s,
              window->end_s, window->rows, samples->period_s, MIN_NOISE * noise);
    add_interference(window);
}

static void open_channel(struct rl_window *window, int channel, bool is_dimmer, double from_s,
                         double to_s)
{
    const struct rl_samples *samples = window->samples;
    const double tiny_s = 0.02 * samples->period_s;
    const int end = rl_samples_row(samples, to_s - tiny_s) + 1;
    window->first = rl_samples_row(samples, from_s + tiny_s);
    window->rows = (end < samples->count ? end : samples->count) - window->first;
    if (window->rows > samples->kept) {
        window->first += window->rows - samples->kept;
        window->rows = samples->kept;
    }
    if (window->rows < 0) {
        window->rows = 0;
    }
    window->begin_s = samples->begin_s + window->first;
    window->end_s = samples->end_s + window->first;
    window->channel = channel;
    window->is_dimmer = is_dimmer;
    window->gain_changes = false;
    whiten(window);
}

void rl_window_open(struct rl_window *window, int channel, bool is_dimmer, double from_s,
                    double to_s)
{
    const struct rl_channel *sum = &window->samples->channel[channel];
    window->others = 0;
    open_channel(window, window->by_zone ? sum->zone[0] : channel, is_dimmer, from_s, to_s);
    for (int i = 1; window->by_zone && i < sum->zones; i++) {
        struct rl_window *other = &window->other[window->others++];
        other->interference = window->interference;
        open_channel(other, sum->zone[i], false, from_s, to_s);
    }
}

double rl_window_null(const struct rl_window *window)
{
    double null = window->whitened.null;
    for (int i = 0; i < window->others; i++) {
        null += window->other[i].whitened.null;
    }
    return null;
}

/* Fit light, as a channel sees it; return the evidence. */
static double fit_channel(struct rl_window *window, const double *light)
{
    double gain[RL_KNOTS];
    window->fit =
        window->gain_changes
            ? rl_fit_knots(&window->whitened, light, window->rows, false, window->on_knot, gain)
            : rl_fit_gain(&window->whitened, light, false);
    return window->fit.log_likelihood - window->whitened.null;
}

double rl_window_fit(struct rl_window *window, const double *light)
{
    double most = fit_channel(window, light), sum = most;
    struct rl_gain best = window->fit;
    window->strongest = window;
    for (int i = 0; i < window->others; i++) {
        struct rl_window *other = &window->other[i];
        const double nats = fit_channel(other, light);
        sum += nats;
        if (nats > most) {
            most = nats;
            best = other->fit;
            window->strongest = other;
        }
    }
    window->fit = best;
    return rl_window_null(window) + sum;
}

double rl_window_try(struct rl_window *window, const struct rl_transmission *transmission)
{
    lay(window, transmission, window->light);
    return rl_window_fit(window, window->light);
}

double rl_window_try_part(struct rl_window *window, const struct rl_transmission *transmission,
                          int split, bool later)
{
    lay(window, transmission, window->light);
    /* A marker that is not there looks as a dark one. */
    for (int row = 0; row < window->rows; row++) {
        window->part[row] = (row >= split) == later ? window->light[row] : 0.0;
    }
    return rl_window_fit(window, window->part);
}

double rl_window_try_two(struct rl_window *window, const struct rl_transmission *one,
                         const struct rl_transmission *other)
{
    lay(window, one, window->part);
    lay(window, other, window->light);
    for (int row = 0; row < window->rows; row++) {
        window->light[row] = fmax(window->light[row] + window->part[row] - 1.0, 0.0);
    }
    return rl_window_fit(window, window->light);
}

void rl_window_add(struct rl_window *window, const struct rl_transmission *transmission)
{
    lay(window, transmission, window->light);
    if (window->whitened.interferers < RL_MAX_INTERFERERS) {
        rl_add_interferer(&window->whitened, window->light);
    }
}

/* The same of a channel; light: of the packet. */
static double follow_gain(struct rl_window *window, const double *light)
{
    const double steady = fit_channel(window, light);
    window->gain_changes = true;
    window->gain_changes = fit_channel(window, light) > steady + rl_price_of_profile();
    return window->gain_changes ? rl_price_of_profile() : 0.0;
}

double rl_window_follow_gain(struct rl_window *window, const struct rl_transmission *transmission)
{
    lay(window, transmission, window->light);
    double price = follow_gain(window, window->light);
    for (int i = 0; i < window->others; i++) {
        price += follow_gain(&window->other[i], window->light);
        price += window->other[i].fit.gain > 0.0 ? RL_COST_OF_GAIN : 0.0;
    }
    return price;
}

void rl_window_keep_gain(struct rl_window *window)
{
    window->gain_changes = false;
    for (int i = 0; i < window->others; i++) {
        window->other[i].gain_changes = false;
    }
}
