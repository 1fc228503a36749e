/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_shares.h"

#include "retrolidar_constants.h"
#include "retrolidar_noise.h"
#include "retrolidar_target.h"
#include "retrolidar_gain_profile.h"

#include <math.h>

int64_t rl_shares_bytes(int rows)
{
    return rows * (int64_t)sizeof(double);
}

void rl_shares_start(struct rl_shares *shares, const struct rl_samples *samples,
                     struct rl_window *window, void *memory)
{
    shares->samples = samples;
    shares->window = window;
    shares->light = memory;
}

/* Rows of the samples that a verdict is of, and the light of its packet in each. */
static int light_of(struct rl_shares *shares, const struct rl_verdict *verdict, int *first)
{
    const struct rl_samples *samples = shares->samples;
    *first = rl_samples_row(samples, verdict->begin_s);
    int rows = rl_samples_row(samples, verdict->end_s) + 1;
    rows = (rows < samples->count ? rows : samples->count) - *first;
    rows = rows < samples->kept ? rows : samples->kept;
    rl_template(&verdict->transmission, samples->begin_s + *first, samples->end_s + *first, rows,
                shares->light);
    return rows;
}

/* How much of how a zone varies from sample to sample a packet explains if its gain may change. */
static struct rl_gain_profile fit_profile(struct rl_shares *shares, int zone, int first, int rows,
                                          double gain[RL_KNOTS])
{
    const struct rl_samples *samples = shares->samples;
    double sum = 0.0;
    const struct rl_column column =
        rl_target_column(samples, zone, first, rows, &shares->window->room);
    for (int row = 0; row < rows; row++) {
        sum += (double)column.signal[row];
    }
    const double noise = rl_noise_variance(samples, zone, sum / rows);
    return rl_gain_profile_fit(column.signal, column.valid, shares->light, rows, noise, gain);
}

int rl_shares_zones(struct rl_shares *shares, const struct rl_verdict *verdict, int *zones,
                    double *gains)
{
    const struct rl_channel *sum = &shares->samples->channel[verdict->channel];
    if (sum->zones == 1) {
        zones[0] = sum->zone[0];
        gains[0] = verdict->fit.gain;
        return 1;
    }
    int first, seen = 0;
    double most = 0.0, explained[RL_MAX_ZONES];
    const int rows = light_of(shares, verdict, &first);
    for (int i = 0; i < sum->zones; i++) {
        double gain[RL_KNOTS];
        explained[i] = fit_profile(shares, sum->zone[i], first, rows, gain).explained;
        most = fmax(most, explained[i]);
    }
    for (int i = 0; i < sum->zones; i++) {
        if (explained[i] >= RL_MIN_PART * most) {
            zones[seen] = sum->zone[i];
            gains[seen++] = explained[i];
        }
    }
    return seen;
}
