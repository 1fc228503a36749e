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
    window->on_knot = rl_take(memory, samples->kept, sizeof(double));
    rl_room_start(&window->room, samples->kept, memory);
}

static void lay_light(struct rl_window *window, const struct rl_transmission *transmission)
{
    rl_template(transmission, window->begin_s, window->end_s, window->rows, window->light);
}

/* Light of an interferer: of what was read of it, or if it continues; then by how much that is more
 * as its gain rises, bends, or changes at will. One form of all markers is tried after the other,
 * as a marker that is still left out may look like another form of one. Seldom, a zone sees less
 * while its neighbour sees more, by what the sensor does against stray light: then the gain is
 * negative.
 */
enum { AS_READ, CONTINUES, RISES, BENDS, CHANGES, FORMS };

struct interferer {
    int marker, form;
    bool continues;
    double gain[RL_KNOTS]; /* of one that changes */
};

static void light_of(struct rl_window *window, const struct interferer *one)
{
    rl_interference_light(&window->interference, one->marker,
                          one->form == CONTINUES || one->continues, window->begin_s,
                          window->end_s, window->rows, window->part, window->light);
}

/* Times `light` by the gain that a form adds, into `part`. */
static void lay_form(struct rl_window *window, const struct interferer *one)
{
    for (int row = 0; row < window->rows; row++) {
        const double at = window->rows > 1 ? 2.0 * row / (window->rows - 1) - 1.0 : 0.0;
        const double gain = one->form == CHANGES
                                ? rl_gain_profile_at(one->gain, row, window->rows)
                            : one->form == BENDS ? at * at
                            : one->form == RISES ? at
                                                 : 1.0;
        window->part[row] = gain * window->light[row];
    }
}

/* What an interferer must explain [nats]. */
static double price_of(const struct interferer *one)
{
    return one->form == CHANGES ? rl_price_of_profile() : RL_COST_OF_GAIN;
}

/* Make all markers that are seen interferers; list these, and return how many they are. */
static int add_interference(struct rl_window *window, struct interferer *added)
{
    const struct rl_interference *interference = &window->interference;
    struct rl_whitened *whitened = &window->whitened;
    bool continues[RL_MAX_TRAINS] = {false}, is_seen[RL_MAX_TRAINS] = {false};
    int count = 0;
    for (int form = 0; form < FORMS; form++) {
        for (int i = 0; i < interference->count; i++) {
            if (interference->marker[i] != i || (form > CONTINUES && !is_seen[i]) ||
                whitened->interferers == RL_MAX_INTERFERERS) {
                continue;
            }
            struct interferer one = {i, form, continues[i], {0.0}};
            light_of(window, &one);
            if (form == CHANGES) {
                rl_fit_knots(whitened, window->light, window->rows, true, window->on_knot,
                             one.gain);
            }
            lay_form(window, &one);
            const struct rl_gain fit = rl_fit_gain(whitened, window->part, true);
            const bool is_negative = form <= CONTINUES && fit.gain < 0.0;
            if (fit.log_likelihood > whitened->null + price_of(&one) +
                                         (is_negative ? RL_COST_OF_CHANCE : 0.0)) {
                rl_add_interferer(whitened, window->part);
                added[count++] = one;
                is_seen[i] = true;
                continues[i] = continues[i] || form == CONTINUES;
            }
        }
    }
    return count;
}

/* Make the light of the reference an interferer: its gain is linear between knots. */
static void add_reference(struct rl_window *window)
{
    rl_reference_light(window->samples, window->reference, window->first, window->rows,
                       window->light);
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        for (int row = 0; row < window->rows; row++) {
            window->part[row] = window->light[row] * rl_knot_weight(knot, row, window->rows);
        }
        rl_add_interferer(&window->whitened, window->part);
    }
}

static void whiten_signal(struct rl_window *window)
{
    const struct rl_samples *samples = window->samples;
    const double noise =
        rl_noise_variance(samples, window->channel, rl_mean(window->column.signal, window->rows));
    rl_whiten(&window->whitened, window->column.signal, window->column.valid, window->begin_s,
              window->end_s, window->rows, samples->period_s, MIN_NOISE * noise);
}

/* Make all markers that are seen beside a packet interferers. The null hypothesis may do without
 * some of these if that is likelier.
 */
static void add_interference_beside(struct rl_window *window)
{
    const int forms[] = {AS_READ, RISES, BENDS};
    struct rl_whitened *whitened = &window->whitened;
    struct interferer added[RL_MAX_INTERFERERS];
    int count = add_interference(window, added);
    double null = whitened->null;
    for (int i = 0; i < count; i++) {
        null -= price_of(&added[i]);
    }
    whiten_signal(window);
    lay_light(window, window->beside);
    for (int i = 0; i < 3; i++) {
        const struct interferer own = {.form = forms[i]};
        lay_form(window, &own);
        rl_add_interferer(whitened, window->part);
    }
    count = add_interference(window, added);
    whiten_signal(window);
    for (int i = 0; i < count; i++) {
        light_of(window, &added[i]);
        lay_form(window, &added[i]);
        rl_add_interferer(whitened, window->part);
        null += price_of(&added[i]);
    }
    whitened->null = fmax(whitened->null, null);
}

static void whiten(struct rl_window *window)
{
    struct interferer added[RL_MAX_INTERFERERS];
    window->column =
        rl_target_column(window->samples, window->channel, window->first, window->rows,
                         window->is_dimmer, &window->room);
    if (window->reference != RL_NO_REFERENCE) {
        rl_reference_erase(window->samples, window->reference, window->first, window->rows,
                           &window->room, &window->column);
    }
    whiten_signal(window);
    if (window->reference != RL_NO_REFERENCE && window->rows > 0) {
        add_reference(window);
        add_interference(window, added);
    } else if (window->beside != NULL && window->rows > 0) {
        add_interference_beside(window);
    } else {
        add_interference(window, added);
    }
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
    window->gain_changes = false;
    whiten(window);
}

/* Fit light, as the channel sees it. */
static double fit(struct rl_window *window, const double *light)
{
    double gain[RL_KNOTS];
    window->fit =
        window->gain_changes
            ? rl_fit_knots(&window->whitened, light, window->rows, false, window->on_knot, gain)
            : rl_fit_gain(&window->whitened, light, false);
    return window->fit.log_likelihood;
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
    window->gain_changes = true;
    window->gain_changes = fit(window, window->light) > steady + rl_price_of_profile();
    return window->gain_changes ? rl_price_of_profile() : 0.0;
}
