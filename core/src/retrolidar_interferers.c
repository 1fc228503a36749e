/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Choose the packets read before that a window may hold besides the one that is judged. */
#include "retrolidar_window.h"

#include "retrolidar_constants.h"
#include "retrolidar_math.h"

#include <math.h>

/* A fit may claim no less than this share of the sensor's noise. */
static const double MIN_NOISE = 0.5;

/* Light of an interferer: of what was read of it; if it continues; and by how much that is more as
 * its gain changes. One form of all markers is tried after the other, as a marker that is still
 * left out may look like another form of one.
 */
enum { AS_READ, CONTINUES, CHANGES, FORMS };

struct interferer {
    int marker, form;
    bool continues;
    double gain[RL_KNOTS]; /* of one that changes */
};

/* What is known of a marker. */
struct marker {
    bool is_seen, continues;
    double gain; /* of what was read */
};

/* Lay the light of all trains of an interferer into the window's; it is bright elsewhere. */
static void lay(struct rl_window *window, const struct interferer *one)
{
    const struct rl_interference *interference = &window->interference;
    const bool continues = one->form == CONTINUES || one->continues;
    int last = one->marker;
    for (int i = one->marker + 1; i < interference->count; i++) {
        if (interference->marker[i] == one->marker &&
            interference->train[i].end_s > interference->train[last].end_s) {
            last = i;
        }
    }
    for (int i = one->marker; i < interference->count; i++) {
        if (interference->marker[i] != one->marker) {
            continue;
        }
        const bool is_first = i == one->marker;
        rl_train_light(&interference->train[i], continues && i == last, window->begin_s,
                       window->end_s, window->rows, is_first ? window->light : window->part);
        for (int row = 0; !is_first && row < window->rows; row++) {
            window->light[row] *= window->part[row];
        }
    }
    for (int row = 0; one->form == CHANGES && row < window->rows; row++) {
        window->light[row] *= rl_gain_profile_at(one->gain, row, window->rows);
    }
}

/* What an interferer must explain [nats]. */
static double price_of(const struct interferer *one)
{
    return one->form == CHANGES ? rl_price_of_profile() : RL_COST_OF_GAIN;
}

/* Make a form of a marker an interferer if it explains what it costs; return whether it does. */
static bool add_form(struct rl_window *window, struct interferer *one, struct marker *marker)
{
    struct rl_whitened *whitened = &window->whitened;
    if (one->form == CHANGES) {
        const struct interferer steady = {one->marker, AS_READ, one->continues, {0.0}};
        lay(window, &steady);
        rl_fit_knots(whitened, window->light, window->rows, true, window->on_knot, one->gain);
    }
    lay(window, one);
    const struct rl_gain fit = rl_fit_gain(whitened, window->light, true);
    /* Seldom, a zone sees less while its neighbour sees more, by what the sensor does against stray
     * light.
     */
    const bool is_negative = one->form < CHANGES && fit.gain < 0.0;
    const double price = price_of(one) + (is_negative ? RL_COST_OF_CHANCE : 0.0);
    /* Another packet would explain about half of one that continues, as all begin alike. */
    const bool is_other = one->form == CONTINUES && fabs(fit.gain) < RL_MOST * fabs(marker->gain);
    if (is_other || fit.log_likelihood <= whitened->null + price) {
        return false;
    }
    rl_add_interferer(whitened, window->light);
    marker->gain = one->form == AS_READ ? fit.gain : marker->gain;
    marker->continues = marker->continues || one->form == CONTINUES;
    marker->is_seen = true;
    return true;
}

/* Make all markers that are seen interferers; list these, and return how many they are. */
static int add_interference(struct rl_window *window, struct interferer *added)
{
    const struct rl_interference *interference = &window->interference;
    struct marker marker[RL_MAX_TRAINS] = {{false, false, 0.0}};
    int count = 0;
    for (int form = 0; form < FORMS; form++) {
        for (int i = 0; i < interference->count; i++) {
            if (interference->marker[i] == i && (form < CHANGES || marker[i].is_seen) &&
                window->whitened.interferers < RL_MAX_INTERFERERS) {
                added[count] = (struct interferer){i, form, marker[i].continues, {0.0}};
                count += add_form(window, &added[count], &marker[i]);
            }
        }
    }
    return count;
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
    struct rl_whitened *whitened = &window->whitened;
    struct interferer added[RL_MAX_INTERFERERS];
    int count = add_interference(window, added);
    double null = whitened->null;
    for (int i = 0; i < count; i++) {
        null -= price_of(&added[i]);
    }
    whiten_signal(window);
    rl_window_add(window, window->beside);
    count = add_interference(window, added);
    whiten_signal(window);
    for (int i = 0; i < count; i++) {
        lay(window, &added[i]);
        rl_add_interferer(whitened, window->light);
        null += price_of(&added[i]);
    }
    whitened->null = fmax(whitened->null, null);
}

void rl_window_whiten(struct rl_window *window)
{
    struct interferer added[RL_MAX_INTERFERERS];
    window->column = rl_target_column(window->samples, window->channel, window->first,
                                      window->rows, window->is_dimmer, &window->room);
    whiten_signal(window);
    if (window->beside != NULL && window->rows > 0) {
        add_interference_beside(window);
    } else {
        add_interference(window, added);
    }
}
