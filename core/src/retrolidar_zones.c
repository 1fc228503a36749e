/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_zones.h"

#include "retrolidar_constants.h"

#include <math.h>

/* Energy of a packet in a zone, beside what else is known to be there; 0 if there is no evidence. */
static double energy_in(struct rl_window *window, int zone, const struct rl_verdict *verdict)
{
    rl_window_open(window, zone, verdict->begin_s, verdict->end_s);
    const double price = rl_window_follow_gain(window, &verdict->transmission);
    const double likelihood = rl_window_try(window, &verdict->transmission);
    double mean = window->has_profile ? 0.0 : 1.0;
    for (int row = 0; window->has_profile && row < window->rows; row++) {
        mean += window->profile[row] / window->rows;
    }
    const double gain = window->fit.gain * mean;
    return likelihood - price > window->whitened.null + RL_COST_OF_CHANCE ? gain * gain : 0.0;
}

int rl_zones_of_packet(struct rl_window *window, const struct rl_verdict *verdict, int *zones,
                       double *strength)
{
    const struct rl_channel *sum = &window->samples->channel[verdict->channel];
    if (sum->zones == 1) {
        zones[0] = sum->zone[0];
        strength[0] = verdict->fit.gain;
        return 1;
    }
    int seen = 0;
    double most = 0.0, energy[RL_MAX_ZONES];
    for (int i = 0; i < sum->zones; i++) {
        energy[i] = energy_in(window, sum->zone[i], verdict);
        most = fmax(most, energy[i]);
    }
    for (int i = 0; i < sum->zones; i++) {
        if (energy[i] >= RL_MIN_PART * most) {
            zones[seen] = sum->zone[i];
            strength[seen++] = energy[i];
        }
    }
    return seen;
}
