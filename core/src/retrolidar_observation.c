/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_observation.h"

#include "retrolidar_constants.h"
#include "retrolidar_refine.h"

#include <math.h>

double rl_observation_half_bits(const struct rl_transmission *transmission, int packets,
                                double to_s)
{
    return transmission->repeats ? (to_s - transmission->start_s) / transmission->bit_s -
                                       RL_PACKET_BITS * packets / 2.0
                                 : RL_PACKET_BITS / 2.0;
}

/* Open the window of a lone packet and of the silence before it; return its evidence. */
static double open_lone(struct rl_window *window, int channel, struct rl_transmission *transmission,
                        double silence_s)
{
    rl_window_open(window, channel, transmission->start_s - silence_s,
                   transmission->start_s + RL_PACKET_BITS * transmission->bit_s);
    return rl_window_refine(window, transmission, RL_PACKET_BITS / 2.0) - window->whitened.null;
}

double rl_observation_open(struct rl_window *window, int channel,
                           struct rl_transmission *transmission, int packets,
                           double consumed_until_s, double since_s, double to_s, int *silent_bits)
{
    *silent_bits = 0;
    if (transmission->repeats) {
        rl_window_open(window, channel,
                       fmax(to_s - RL_PACKET_BITS * packets * transmission->bit_s, since_s), to_s);
        return rl_window_refine(window, transmission,
                                rl_observation_half_bits(transmission, packets, to_s)) -
               window->whitened.null;
    }
    const double tight = open_lone(window, channel, transmission, 0.0);
    const double silence_s =
        fmin(RL_SILENT_BITS * transmission->bit_s, transmission->start_s - consumed_until_s);
    if (silence_s < transmission->bit_s) {
        return tight;
    }
    struct rl_transmission lone = *transmission;
    const double wide = open_lone(window, channel, &lone, silence_s);
    if (wide > tight) {
        *transmission = lone;
        *silent_bits = (int)floor(silence_s / lone.bit_s);
        return wide;
    }
    return open_lone(window, channel, transmission, 0.0);
}

bool rl_observation_is_erased(const struct rl_window *window,
                              const struct rl_transmission *transmission)
{
    const struct rl_whitened *whitened = &window->whitened;
    double known[RL_PACKET_BITS] = {0.0}, all[RL_PACKET_BITS] = {0.0};
    const struct rl_samples *samples = window->samples;
    int sample = 0, erased = 0;
    if (whitened->samples < window->rows / 2) {
        return true;
    }
    for (int row = 0; row < window->rows; row++) {
        const bool valid = sample < whitened->samples && whitened->row[sample] == row;
        sample += valid;
        const double middle_s =
            (samples->begin_s[window->first + row] + samples->end_s[window->first + row]) / 2;
        const double since = floor((middle_s - transmission->start_s) / transmission->bit_s);
        if (!transmission->repeats && (since < 0.0 || since >= RL_PACKET_BITS)) {
            continue;
        }
        const int bit = (int)(since - RL_PACKET_BITS * floor(since / RL_PACKET_BITS));
        all[bit] += 1.0;
        known[bit] += valid;
    }
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        erased += known[bit] < 0.25 * all[bit];
    }
    /* Words still differ in the bits that are left. */
    return erased >= RL_WORD_DISTANCE;
}
