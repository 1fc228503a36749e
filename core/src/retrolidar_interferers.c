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

/* What is known of a marker. */
struct marker {
    bool is_seen, continues;
    double gain; /* of what was read */
};

/* Make a form of a marker an interferer if it explains what it costs. */
static void add_form(struct rl_window *window, int index, int form, struct marker *marker)
{
    struct rl_whitened *whitened = &window->whitened;
    double price = RL_COST_OF_GAIN;
    rl_interference_light(&window->interference, index, form == CONTINUES || marker->continues,
                          window->begin_s, window->end_s, window->rows, window->part,
                          window->light);
    if (form == CHANGES) {
        double gain[RL_KNOTS];
        rl_fit_knots(whitened, window->light, window->rows, true, window->on_knot, gain);
        for (int row = 0; row < window->rows; row++) {
            window->light[row] *= rl_gain_profile_at(gain, row, window->rows);
        }
        price = rl_price_of_profile();
    }
    const struct rl_gain fit = rl_fit_gain(whitened, window->light, true);
    /* Seldom, a zone sees less while its neighbour sees more, by what the sensor does against stray
     * light.
     */
    price += form < CHANGES && fit.gain < 0.0 ? RL_COST_OF_CHANCE : 0.0;
    /* Another packet would explain about half of one that continues, as all begin alike. */
    const bool is_other = form == CONTINUES && fabs(fit.gain) < RL_MOST * fabs(marker->gain);
    if (is_other || fit.log_likelihood <= whitened->null + price) {
        return;
    }
    rl_add_interferer(whitened, window->light);
    marker->gain = form == AS_READ ? fit.gain : marker->gain;
    marker->continues = marker->continues || form == CONTINUES;
    marker->is_seen = true;
}

/* Make all markers that are seen interferers. */
static void add_interference(struct rl_window *window)
{
    const struct rl_interference *interference = &window->interference;
    struct marker marker[RL_MAX_TRAINS] = {{false, false, 0.0}};
    for (int form = 0; form < FORMS; form++) {
        for (int i = 0; i < interference->count; i++) {
            if (interference->marker[i] == i && (form < CHANGES || marker[i].is_seen) &&
                window->whitened.interferers < RL_MAX_INTERFERERS) {
                add_form(window, i, form, &marker[i]);
            }
        }
    }
}

void rl_window_whiten(struct rl_window *window)
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
