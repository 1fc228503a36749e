/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Log likelihood of samples with a packet: its gain is fitted by least squares to whitened samples,
 * along with the gains of the packets that interfere.
 */
#ifndef RETROLIDAR_LIKELIHOOD_H
#define RETROLIDAR_LIKELIHOOD_H

#include "retrolidar_gain_profile.h"

/* binding */
/* A template that is fitted to samples. */
struct rl_gain {
    double log_likelihood; /* with the packet, the best of all q */
    double gain;           /* g at that q, not negative */
    double variance;       /* s at that q */
    int walk;              /* which q that is */
};
/* end of binding */

/* Fit a template, the light of each row of the window, together with the interferers.
 *
 * may_darken: whether its gain may be negative, too
 */
struct rl_gain rl_fit_gain(const struct rl_whitened *whitened, const double *light,
                           bool may_darken);

/* The same with a gain that changes. Return its mean.
 *
 * part: memory for as many rows
 * gains: on each knot
 */
struct rl_gain rl_fit_knots(const struct rl_whitened *whitened, const double *light, int rows,
                            bool may_darken, double *part, double gains[RL_KNOTS]);

/* Make a template an interferer: from now on its gain, which may be negative, is fitted along with
 * that of any other, and the null hypothesis has it, too. There must be room.
 */
void rl_add_interferer(struct rl_whitened *whitened, const double *light);

#endif
