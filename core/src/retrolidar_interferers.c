/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Choose the packets, or the zone beside, that a window's samples may hold besides the packet. */
#include "retrolidar_window.h"

#include "retrolidar_constants.h"
#include "retrolidar_math.h"

#include <math.h>

/* A fit may claim no less than this share of the sensor's noise. */
static const double MIN_NOISE = 0.5;

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
    rl_template(window->beside, window->begin_s, window->end_s, window->rows, window->light);
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

void rl_window_whiten(struct rl_window *window)
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
