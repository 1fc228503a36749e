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
    return rl_window_refine(window, transmission, RL_PACKET_BITS / 2.0) - window->null;
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
               window->null;
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

/* Half of the samples of a window must be valid. */
static int min_rows(const struct rl_window *window)
{
    return window->rows / 2;
}

bool rl_observation_is_erased(const struct rl_window *window,
                              const struct rl_transmission *transmission)
{
    const struct rl_whitened *whitened = &window->whitened[0];
    double known[RL_PACKET_BITS] = {0.0}, all[RL_PACKET_BITS] = {0.0};
    const struct rl_samples *samples = window->samples;
    int sample = 0, erased = 0;
    if (whitened->samples < min_rows(window)) {
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

bool rl_observation_mask_occlusion(struct rl_window *window,
                                   const struct rl_transmission *transmission, double least)
{
    double best = least;
    int from = 0, to = 0;
    for (int length = 1; length < RL_LOOK_BITS; length++) {
        for (int begin = 1; begin + length < RL_PACKET_BITS; begin++) {
            uint32_t dark = transmission->bits;
            for (int bit = begin; bit < begin + length; bit++) {
                dark |= rl_packet_bit(bit);
            }
            const double likelihood =
                dark == transmission->bits ? best : rl_window_try_bits(window, transmission, dark);
            if (likelihood > best) {
                best = likelihood;
                from = begin;
                to = begin + length;
            }
        }
    }
    if (to == 0) {
        return false;
    }
    /* Half a bit at either end may be hidden, too. */
    const double lasting_s = (to - from + 1) * transmission->bit_s;
    double from_s = transmission->start_s + (from - 0.5) * transmission->bit_s;
    /* Of a packet that repeats, the window holds the bits of the one that began before or in it. */
    if (transmission->repeats && from_s + lasting_s < window->samples->begin_s[window->first]) {
        from_s += RL_PACKET_BITS * transmission->bit_s;
    }
    rl_window_hide(window, from_s, from_s + lasting_s);
    return true;
}

/* Whether most of how a channel varies beyond noise is the template that was tried last. */
static bool is_seen(const struct rl_window *window, int index)
{
    const struct rl_whitened *whitened = &window->whitened[index];
    double sum = 0.0, square = 0.0;
    for (int row = 0; row < window->rows; row++) {
        sum += window->light[row];
        square += window->light[row] * window->light[row];
    }
    const double gain = window->fit[index].gain;
    const double explained = gain * gain * (square - sum * sum / window->rows) / window->rows;
    const double noise = 2.0 * whitened->least;
    return explained > 0.5 * (whitened->squares[0] / (whitened->samples - 1) - noise);
}

void rl_observation_add_zones(struct rl_window *window, const struct rl_transmission *transmission,
                              double evidence)
{
    const struct rl_samples *samples = window->samples;
    const struct rl_channel *of = &samples->channel[window->channel[0]];
    if (of->zones > 1) {
        return;
    }
    const int row = of->zone[0] / samples->columns_of_zones;
    const int column = of->zone[0] % samples->columns_of_zones;
    for (int down = -1; down <= 1; down++) {
        for (int right = -1; right <= 1; right++) {
            const int r = row + down, c = column + right;
            const int before = window->channels;
            if (r < 0 || c < 0 || r >= samples->rows_of_zones || c >= samples->columns_of_zones) {
                continue;
            }
            rl_window_add(window, r * samples->columns_of_zones + c);
            if (window->channels == before) {
                continue;
            }
            const double together = rl_window_try(window, transmission) - window->null;
            /* It must add more than a gain costs. Distances of a zone in which others are seen,
             * too, may be theirs.
             */
            if (window->whitened[before].samples < min_rows(window) ||
                window->whitened[before].interferers > 0 ||
                together - evidence < 2.0 * RL_COST_OF_GAIN || !is_seen(window, before)) {
                rl_window_drop(window);
            } else {
                evidence = together;
            }
        }
    }
}
