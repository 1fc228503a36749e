/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_window.h"

#include "retrolidar_constants.h"
#include "retrolidar_math.h"

#include <math.h>
#include <string.h>

/* A fit may claim no less than this share of the sensor's noise. */
static const double MIN_NOISE = 0.5;

void rl_window_start(struct rl_window *window, const struct rl_samples *samples,
                     struct rl_memory *memory)
{
    memset(window, 0, sizeof *window);
    window->samples = samples;
    window->reference = RL_NO_REFERENCE;
    rl_whitened_start(&window->whitened, samples->kept, memory);
    window->light = rl_take(memory, samples->kept, sizeof(double));
    window->part = rl_take(memory, samples->kept, sizeof(double));
    window->seen = rl_take(memory, samples->kept, sizeof(double));
    window->profile = rl_take(memory, samples->kept, sizeof(double));
    rl_room_start(&window->room, samples->kept, memory);
}

static void light_of(struct rl_window *window, int marker, bool continues)
{
    rl_interference_light(&window->interference, marker, continues, window->begin_s,
                          window->end_s, window->rows, window->part, window->light);
}

/* Fit how the gain of `light` changes. */
static void find_profile(struct rl_window *window)
{
    double gain[RL_KNOTS], most = 0.0;
    rl_gain_profile_fit(window->column.signal, window->column.valid, window->light, window->rows,
                        gain);
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        gain[knot] = fmax(gain[knot], 0.0);
        most = fmax(most, gain[knot]);
    }
    for (int row = 0; row < window->rows; row++) {
        window->profile[row] =
            most > 0.0 ? rl_gain_profile_at(gain, row, window->rows) / most : 1.0;
    }
}

/* Light of an interferer: what was read of it, what it sends if it continues, and either with a
 * gain that changes. One form of all markers is tried after the other, as a marker that is still
 * left out may look like another form of one. Seldom, a zone sees less while its neighbour sees
 * more, by what the sensor does against stray light: then the gain is negative.
 */
enum { AS_READ, CONTINUES, CHANGES, FORMS };

/* Lay one form of an interferer into `part`. */
static void lay_interferer(struct rl_window *window, int marker, int form, bool continues)
{
    light_of(window, marker, form == CONTINUES || continues);
    memcpy(window->part, window->light, (size_t)window->rows * sizeof *window->part);
    if (form == CHANGES) {
        find_profile(window);
        for (int row = 0; row < window->rows; row++) {
            window->part[row] *= window->profile[row];
        }
    }
}

/* Make all markers that are seen interferers. */
static void add_interference(struct rl_window *window)
{
    const struct rl_interference *interference = &window->interference;
    struct rl_whitened *whitened = &window->whitened;
    bool continues[RL_MAX_TRAINS] = {false};
    for (int form = 0; form < FORMS; form++) {
        const double price = form == CHANGES ? rl_price_of_profile() : RL_COST_OF_GAIN;
        for (int i = 0; i < interference->count; i++) {
            if (interference->marker[i] != i || whitened->interferers == RL_MAX_INTERFERERS) {
                continue;
            }
            lay_interferer(window, i, form, continues[i]);
            const struct rl_gain fit = rl_fit_gain(whitened, window->part, true);
            const double of_sign = fit.gain < 0.0 ? RL_COST_OF_CHANCE : 0.0;
            if (fit.log_likelihood > whitened->null + price + of_sign) {
                rl_add_interferer(whitened, window->part);
                continues[i] = continues[i] || form == CONTINUES;
            }
        }
    }
}

/* Make the light of the reference an interferer: its gain is linear between knots. */
static void add_reference(struct rl_window *window)
{
    rl_reference_light(window->samples, window->reference, window->first, window->rows,
                       window->light);
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        double gain[RL_KNOTS] = {0.0};
        gain[knot] = 1.0;
        for (int row = 0; row < window->rows; row++) {
            window->part[row] = window->light[row] * rl_gain_profile_at(gain, row, window->rows);
        }
        rl_add_interferer(&window->whitened, window->part);
    }
}

static void whiten(struct rl_window *window)
{
    const struct rl_samples *samples = window->samples;
    struct rl_column column =
        rl_target_column(samples, window->channel, window->first, window->rows, window->is_dimmer,
                         &window->room);
    if (window->reference != RL_NO_REFERENCE) {
        rl_reference_erase(samples, window->reference, window->first, window->rows, &window->room,
                           &column);
    }
    const double noise =
        rl_noise_variance(samples, window->channel, rl_mean(column.signal, window->rows));
    window->column = column;
    rl_whiten(&window->whitened, column.signal, column.valid, window->begin_s, window->end_s,
              window->rows, samples->period_s, MIN_NOISE * noise);
    if (window->reference != RL_NO_REFERENCE && window->rows > 0) {
        add_reference(window);
    }
    add_interference(window);
}

void rl_window_open(struct rl_window *window, int channel, bool is_dimmer, double from_s,
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
    window->has_profile = false;
    whiten(window);
}

/* Fit light, as the channel sees it. */
static double fit(struct rl_window *window, const double *light)
{
    for (int row = 0; window->has_profile && row < window->rows; row++) {
        window->seen[row] = light[row] * window->profile[row];
    }
    window->fit =
        rl_fit_gain(&window->whitened, window->has_profile ? window->seen : light, false);
    return window->fit.log_likelihood;
}

static void lay_light(struct rl_window *window, const struct rl_transmission *transmission)
{
    rl_template(transmission, window->begin_s, window->end_s, window->rows, window->light);
}

double rl_window_try_light(struct rl_window *window)
{
    return fit(window, window->light);
}

double rl_window_try(struct rl_window *window, const struct rl_transmission *transmission)
{
    lay_light(window, transmission);
    return fit(window, window->light);
}

double rl_window_try_part(struct rl_window *window, const struct rl_transmission *transmission,
                          int split, bool later)
{
    lay_light(window, transmission);
    /* A marker that is not there looks as a dark one. */
    for (int row = 0; row < window->rows; row++) {
        window->part[row] = (row >= split) == later ? window->light[row] : 0.0;
    }
    return fit(window, window->part);
}

double rl_window_try_stretch(struct rl_window *window, const struct rl_transmission *transmission,
                             uint32_t bits, double from_s, double to_s)
{
    struct rl_transmission other = *transmission;
    other.bits = bits;
    lay_light(window, transmission);
    memcpy(window->part, window->light, (size_t)window->rows * sizeof *window->part);
    lay_light(window, &other);
    for (int row = 0; row < window->rows; row++) {
        if (window->begin_s[row] >= from_s && window->begin_s[row] < to_s) {
            window->part[row] = window->light[row];
        }
    }
    return fit(window, window->part);
}

double rl_window_try_two(struct rl_window *window, const struct rl_transmission *one,
                         const struct rl_transmission *other)
{
    lay_light(window, one);
    memcpy(window->part, window->light, (size_t)window->rows * sizeof *window->part);
    lay_light(window, other);
    for (int row = 0; row < window->rows; row++) {
        window->light[row] = fmax(window->light[row] + window->part[row] - 1.0, 0.0);
    }
    return fit(window, window->light);
}

void rl_window_add(struct rl_window *window, const struct rl_transmission *transmission)
{
    lay_light(window, transmission);
    if (window->whitened.interferers < RL_MAX_INTERFERERS) {
        rl_add_interferer(&window->whitened, window->light);
    }
}

double rl_window_follow_gain(struct rl_window *window, const struct rl_transmission *transmission)
{
    const double steady = rl_window_try(window, transmission);
    find_profile(window);
    window->has_profile = true;
    window->has_profile = fit(window, window->light) > steady + rl_price_of_profile();
    return window->has_profile ? rl_price_of_profile() : 0.0;
}
