/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Start and bit period of a packet, found closely in a window. */
#include "retrolidar_constants.h"
#include "retrolidar_window.h"

#include <math.h>

/* Move the middle of the window by some time, and the bit period by another. */
static struct rl_transmission moved(const struct rl_transmission *transmission, double half_bits,
                                    double later_s, double longer_s)
{
    struct rl_transmission other = *transmission;
    other.start_s += later_s - half_bits * longer_s;
    other.bit_s += longer_s;
    return other;
}

/* Where a parabola through three points that are a step apart is highest, in steps. */
static double parabolic_peak(double before, double here, double after)
{
    const double bend = before - 2.0 * here + after;
    return bend < 0.0 ? fmin(fmax(0.5 * (before - after) / bend, -1.0), 1.0) : 0.0;
}

static void coordinate_ascent(struct rl_window *window, struct rl_transmission *transmission,
                              double half_bits)
{
    double best = rl_window_try(window, transmission);
    /* Each round has half the steps of the one before. */
    double later_s = transmission->bit_s / 8;
    for (int round = 0; round < RL_TRIED; round++, later_s /= 2) {
        for (int axis = 0; axis < 2; axis++) {
            const double longer_s = axis ? later_s / half_bits : 0.0;
            const double shift_s = axis ? 0.0 : later_s;
            struct rl_transmission one = moved(transmission, half_bits, -shift_s, -longer_s);
            struct rl_transmission other = moved(transmission, half_bits, shift_s, longer_s);
            if (one.bit_s < window->min_bit_s || other.bit_s > window->max_bit_s) {
                continue;
            }
            const double before = rl_window_try(window, &one);
            const double after = rl_window_try(window, &other);
            const double at = parabolic_peak(before, best, after);
            struct rl_transmission tried =
                moved(transmission, half_bits, at * shift_s, at * longer_s);
            double likelihood = at == 0.0 ? best : rl_window_try(window, &tried);
            if (before > likelihood) {
                likelihood = before;
                tried = one;
            }
            if (after > likelihood) {
                likelihood = after;
                tried = other;
            }
            if (likelihood > best) {
                best = likelihood;
                *transmission = tried;
            }
        }
    }
}

/* Whether the bits that touch a lone packet are better dark than as they are. */
static bool find_neighbours(struct rl_window *window, struct rl_transmission *transmission)
{
    const struct rl_transmission found = *transmission;
    double best = rl_window_try(window, &found) + log(2.0); /* one of two, by chance */
    for (int dark = 0; dark < 4; dark++) {
        struct rl_transmission other = found;
        other.dark_before = (dark & 1) != 0;
        other.dark_after = (dark & 2) != 0;
        const double likelihood = rl_window_try(window, &other);
        if (likelihood > best) {
            best = likelihood;
            *transmission = other;
        }
    }
    return transmission->dark_before != found.dark_before ||
           transmission->dark_after != found.dark_after;
}

double rl_window_refine(struct rl_window *window, struct rl_transmission *transmission,
                        double half_bits)
{
    coordinate_ascent(window, transmission, half_bits);
    if (!transmission->repeats && find_neighbours(window, transmission)) {
        coordinate_ascent(window, transmission, half_bits);
    }
    /* So that `fit` and `light` are of what is returned. */
    return rl_window_try(window, transmission);
}
