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

/* Make a train that was read an interferer if it explains what it costs: its light, or (`changes`)
 * by how much that is more as its gain changes. Return whether it does.
 */
static bool add(struct rl_window *window, const struct rl_packet_train *train, bool changes)
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
                is_seen[i] = add(window, &interference->train[i], changes);
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
