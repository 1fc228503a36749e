/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A rival of a packet: a known marker that sends again after a pause. The end of its last packet
 * and the beginning of the next one may look like a packet of another ID.
 */
#include "retrolidar_decide.h"

#include <math.h>

/* Log likelihood of the last packet of a marker and of a next one that begins at any time. */
static double find_next(const struct rl_case *judged, const struct rl_transmission *last,
                        double ended_s)
{
    struct rl_transmission next = *last;
    double best = -INFINITY, best_s = ended_s, step_s = last->bit_s / RL_PHASES;
    for (next.start_s = ended_s; next.start_s < judged->to_s; next.start_s += step_s) {
        const double likelihood = rl_window_try_two(judged->window, last, &next);
        best_s = likelihood > best ? next.start_s : best_s;
        best = fmax(best, likelihood);
    }
    for (int round = 0; round < RL_TRIED; round++) {
        const double middle_s = best_s;
        step_s /= 2;
        for (int side = -1; side <= 1; side += 2) {
            next.start_s = middle_s + side * step_s;
            const double likelihood = rl_window_try_two(judged->window, last, &next);
            best_s = likelihood > best ? next.start_s : best_s;
            best = fmax(best, likelihood);
        }
    }
    return best;
}

double rl_rivals_next(const struct rl_case *judged)
{
    const struct rl_interference *known = &judged->window->interference;
    double best = -INFINITY;
    for (int i = 0; i < known->count; i++) {
        struct rl_transmission last = known->train[i].transmission;
        last.repeats = last.dark_before = last.dark_after = false;
        last.start_s = rl_last_start(&last, known->train[i].end_s - last.bit_s);
        const double ended_s = last.start_s + RL_PACKET_BITS * last.bit_s;
        if (ended_s > judged->window->begin_s[0]) {
            best = fmax(best, find_next(judged, &last, ended_s));
        }
    }
    /* That a known marker sends again is likelier than that an unknown one begins. */
    return best + RL_COST_OF_CHANCE;
}
