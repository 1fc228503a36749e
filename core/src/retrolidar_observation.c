/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* The window that a packet is judged in, whether that is enough, and the packet's exact time. */
#include "retrolidar_decide.h"

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

static double coordinate_ascent(struct rl_window *window, struct rl_transmission *transmission,
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
    return best;
}

/* Whether the bits that touch a lone packet are better dark than as they are. */
static bool find_neighbours(struct rl_window *window, struct rl_transmission *transmission)
{
    const struct rl_transmission found = *transmission;
    double best = rl_window_try(window, &found) + log(2.0); /* price of a choice of two */
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
    const double best = coordinate_ascent(window, transmission, half_bits);
    return !transmission->repeats && find_neighbours(window, transmission)
               ? coordinate_ascent(window, transmission, half_bits)
               : best;
}

/* Bits from the start of the transmission to the middle of its window. */
static double half_bits_of(const struct rl_case *judged)
{
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    return transmission->repeats
               ? (judged->to_s - transmission->start_s) / transmission->bit_s -
                     RL_PACKET_BITS * judged->verdict.packets / 2.0
               : RL_PACKET_BITS / 2.0;
}

static double evidence_of(struct rl_window *window, const struct rl_transmission *transmission)
{
    return rl_window_try(window, transmission) - rl_window_null(window);
}

/* Refine a packet in the window that is open; return its evidence. What explains less than a gain
 * costs is left as it is: most of what the search finds beside packets that were read before.
 */
static double refine_evident(struct rl_window *window, struct rl_transmission *transmission,
                             double half_bits)
{
    const double evidence = evidence_of(window, transmission);
    return evidence < RL_COST_OF_GAIN ? evidence
                                      : rl_window_refine(window, transmission, half_bits) -
                                            rl_window_null(window);
}

/* Open the window of a lone packet with the silence before it. */
static void open_lone(struct rl_case *judged, const struct rl_transmission *lone, double silence_s)
{
    rl_window_open(judged->window, judged->verdict.channel, judged->verdict.is_dimmer,
                   lone->start_s - silence_s, lone->start_s + RL_PACKET_BITS * lone->bit_s);
}

/* Open it with the silence, or without, whichever is better, and refine it there; return its
 * evidence.
 */
static double open_best(struct rl_case *judged, struct rl_transmission *lone)
{
    struct rl_window *window = judged->window;
    const double half_bits = RL_PACKET_BITS / 2.0;
    open_lone(judged, lone, 0.0);
    const double tight = refine_evident(window, lone, half_bits);
    const double silence_s =
        fmin(RL_SILENT_BITS * lone->bit_s, lone->start_s - judged->read_until_s);
    if (silence_s < lone->bit_s || tight < RL_COST_OF_GAIN) {
        return tight;
    }
    struct rl_transmission other = *lone;
    open_lone(judged, lone, silence_s);
    const double wide = refine_evident(window, &other, half_bits);
    if (wide > tight) {
        *lone = other;
        judged->silent_bits = (int)fmin(silence_s / other.bit_s, RL_SILENT_BITS);
        return wide;
    }
    open_lone(judged, lone, 0.0);
    return evidence_of(window, lone);
}

/* Open the window of a packet, and refine it there. */
static void open_target(struct rl_case *judged, bool is_dimmer)
{
    struct rl_window *window = judged->window;
    struct rl_verdict *verdict = &judged->verdict;
    struct rl_transmission *transmission = &verdict->transmission;
    const int bits = RL_PACKET_BITS * verdict->packets;
    verdict->is_dimmer = is_dimmer;
    judged->silent_bits = 0;
    if (transmission->repeats) {
        const double begin_s = fmax(judged->to_s - bits * transmission->bit_s, judged->since_s);
        rl_window_open(window, verdict->channel, is_dimmer, begin_s, judged->to_s);
        verdict->evidence = refine_evident(window, transmission, half_bits_of(judged));
        verdict->begin_s = fmax(judged->to_s - bits * transmission->bit_s, judged->since_s);
        verdict->end_s = judged->to_s;
    } else {
        verdict->evidence = open_best(judged, transmission);
        verdict->begin_s = transmission->start_s;
        verdict->end_s = transmission->start_s + bits * transmission->bit_s;
    }
}

void rl_observation_open(struct rl_case *judged)
{
    struct rl_verdict *verdict = &judged->verdict;
    const struct rl_transmission found = verdict->transmission;
    open_target(judged, false);
    /* The marker is the target that the packet explains better. */
    if (judged->window->column.has_two_targets && !judged->window->by_zone) {
        const double evidence = verdict->evidence;
        verdict->transmission = found;
        open_target(judged, true);
        if (verdict->evidence <= evidence) {
            verdict->transmission = found;
            open_target(judged, false);
        }
    }
    judged->half_bits = half_bits_of(judged);
    judged->log_likelihood = verdict->evidence + rl_window_null(judged->window);
}

/* Whether any zone of a window has a valid sample. */
static bool is_valid(const struct rl_window *window, int row)
{
    bool is_any = window->column.valid[row];
    for (int i = 0; i < window->others; i++) {
        is_any = is_any || window->other[i].column.valid[row];
    }
    return is_any;
}

bool rl_observation_is_erased(const struct rl_case *judged)
{
    const struct rl_window *window = judged->window;
    const struct rl_transmission *transmission = &judged->verdict.transmission;
    double known[RL_PACKET_BITS] = {0.0}, all[RL_PACKET_BITS] = {0.0};
    int valid = 0, erased = 0;
    for (int row = 0; row < window->rows; row++) {
        const bool is_known = is_valid(window, row);
        const double middle_s = (window->begin_s[row] + window->end_s[row]) / 2;
        const double since = floor((middle_s - transmission->start_s) / transmission->bit_s);
        valid += is_known;
        if (transmission->repeats || (since >= 0.0 && since < RL_PACKET_BITS)) {
            all[rl_bit_of((int)since)] += 1.0;
            known[rl_bit_of((int)since)] += is_known;
        }
    }
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        erased += known[bit] < 0.25 * all[bit];
    }
    /* If fewer are erased, all words still differ in the others. */
    return valid < window->rows / 2 || erased >= RL_WORD_DISTANCE;
}
