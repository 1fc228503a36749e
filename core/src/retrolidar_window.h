/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A window of samples of a channel, or of each zone of a sum, and how well packets explain it. */
#ifndef RETROLIDAR_WINDOW_H
#define RETROLIDAR_WINDOW_H

#include "retrolidar_likelihood.h"
#include "retrolidar_target.h"
#include "retrolidar_template.h"

enum { RL_SUMMED = 4 }; /* zones of a sum that are judged zone by zone, at most */

struct rl_window {
    const struct rl_samples *samples;
    int first, rows; /* in the samples */
    const double *begin_s, *end_s; /* of each exposure [s] */
    int channel;
    bool is_dimmer; /* whether the marker is the dimmer one of two targets */
    struct rl_column column;             /* samples of that target ... */
    struct rl_whitened whitened;         /* ... and whitened */
    struct rl_gain fit;                  /* of the template that was tried last */
    struct rl_interference interference; /* trains in the windows that are opened next */
    double min_bit_s, max_bit_s;         /* limits of a refinement */
    double *light;                       /* of the template that was tried last */
    double *part;                        /* of the light of an interferer */
    double *on_knot;                     /* light of a knot of its gain */
    bool gain_changes;                   /* whether gains may change */
    struct rl_room room;
    const struct rl_window *strongest; /* in which the light explains most: that of the fit */
    bool by_zone; /* whether each zone of a sum has gain, interferers and noise of its own */
    int others;
    struct rl_window *other; /* of the other zones: RL_SUMMED - 1 */
};

void rl_window_start(struct rl_window *window, const struct rl_samples *samples,
                     struct rl_memory *memory);

/* Open the exposures of a channel from one time to another, and whiten them; with `by_zone`, those
 * of each zone of a sum, whose likelihoods are added.
 */
void rl_window_open(struct rl_window *window, int channel, bool is_dimmer, double from_s,
                    double to_s);

/* Log likelihood without a packet. */
double rl_window_null(const struct rl_window *window);

/* Log likelihood of a transmission. */
double rl_window_try(struct rl_window *window, const struct rl_transmission *transmission);

/* The same of any light, of each row. `fit` becomes that of the channel in which it is clearest. */
double rl_window_fit(struct rl_window *window, const double *light);

/* The same if the marker appears in a row of the window (`later`), or vanishes there. */
double rl_window_try_part(struct rl_window *window, const struct rl_transmission *transmission,
                          int split, bool later);

/* The same of two lone packets, one of which follows the other. */
double rl_window_try_two(struct rl_window *window, const struct rl_transmission *one,
                         const struct rl_transmission *other);

/* Find the start and the bit period that are likeliest, near to those given; return the log
 * likelihood. The limits of the bit period are to be set before.
 *
 * half_bits: from the start to the time that stays where it is if the bit period changes
 */
double rl_window_refine(struct rl_window *window, struct rl_transmission *transmission,
                        double half_bits);

/* Fit the gain of a packet along with that of any other. */
void rl_window_add(struct rl_window *window, const struct rl_transmission *transmission);

/* Fit a changing gain to a packet. If it explains more than it costs, the gain of all that is tried
 * in this window may change from now on, as rivals may move, too. Return the cost [nats].
 */
double rl_window_follow_gain(struct rl_window *window, const struct rl_transmission *transmission);

/* From now on, none may. */
void rl_window_keep_gain(struct rl_window *window);

#endif
