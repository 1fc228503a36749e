/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Log likelihood of the samples of a channel in a window, with a packet and without.
 *
 *     x_k = a + g T_k + l_k + n_k,   g > 0 with a packet, g = 0 without
 *
 * n is white, of variance s; l is a random walk of variance q s for each frame period; a is
 * unknown. This is the local level model (Harvey 1989; Durbin and Koopman 2012): for a given q, one
 * pass of a scalar Kalman filter whitens the samples, and the template by the same gains. Then g is
 * fitted by least squares, along with the gains of the packets that interfere.
 */
#ifndef RETROLIDAR_LIKELIHOOD_H
#define RETROLIDAR_LIKELIHOOD_H

#include "retrolidar_constants.h"
#include "retrolidar_math.h"

#include <stdbool.h>
#include <stdint.h>

enum {
    /* Templates of packets that are fitted along with the one that is tried. */
    RL_MAX_INTERFERERS = 2 * RL_PARTS,
    RL_WALKS = 9,       /* values of q that are tried */
    RL_WALK_LANES = 10, /* the same, rounded up to an even number */
    RL_WANDERS = 3,     /* index of q from which on the level wanders */
};
/* A template of less energy is constant in the window. */
static const double RL_NO_ENERGY = 1e-9;

/* Samples of a channel in a window, whitened for every q. */
struct rl_whitened {
    int samples;                     /* valid ones */
    int *row;                        /* of each, in the window */
    double (*gain)[RL_WALK_LANES];   /* of the filter, for each sample */
    double (*scale)[RL_WALK_LANES];  /* 1 over the deviation of each innovation */
    double (*signal)[RL_WALK_LANES]; /* whitened */
    int interferers;
    /* Templates of other packets, whitened and orthonormal; they are subtracted from the signal.
     * The last ones are memory for the template that is tried, on each knot.
     */
    double (*interferer[RL_MAX_INTERFERERS + RL_KNOTS])[RL_WALK_LANES];
    double squares[RL_WALK_LANES];
    double log_scales[RL_WALK_LANES]; /* sum of the logarithms of 1/deviation */
    double least;                     /* least variance of noise that a fit may claim */
    double null;                      /* log likelihood without a packet, the best of all q */
    int null_walk;                    /* which q that is */
};

/* A template that is fitted to samples. */
struct rl_gain {
    double log_likelihood; /* with the packet, the best of all q */
    double gain;           /* g at that q */
    int walk;              /* which q that is */
};

/* Take the arrays of a window of so many rows at the most. */
void rl_whitened_start(struct rl_whitened *whitened, int rows, struct rl_memory *memory);

/* Whiten a window.
 *
 * signal, valid, begin_s, end_s: of each row
 * period_s: of the frames; least: variance of noise that there is at least
 */
void rl_whiten(struct rl_whitened *whitened, const float *signal, const uint8_t *valid,
               const double *begin_s, const double *end_s, int rows, double period_s, double least);

/* Subtract what interferers explain from the signal of the valid rows, by whitening it back, with a
 * level that hardly wanders.
 */
void rl_unwhiten(const struct rl_whitened *whitened, float *signal);

/* Log likelihood of the samples for one q, with the sum of squares that a fit leaves; parameters:
 * that are fitted, besides the interferers.
 */
double rl_log_likelihood(const struct rl_whitened *whitened, int walk, double squares,
                         int parameters);

/* Find the log likelihood without a packet. */
void rl_find_null(struct rl_whitened *whitened);

/* Fit a template, the light of each row of the window, together with the interferers.
 *
 * may_darken: whether its gain may be negative, too
 */
struct rl_gain rl_fit_gain(const struct rl_whitened *whitened, const double *light,
                           bool may_darken);

/* The same with a gain that changes during the packet, of a marker that moves or in light that
 * sways: it is linear between RL_KNOTS knots, equally spaced over the rows. Return its mean.
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

/* What a gain that changes must explain besides a steady one [nats]. */
static inline double rl_price_of_profile(void)
{
    return RL_COST_OF_GAIN * (RL_KNOTS - 1);
}

/* The gain in a row. */
double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows);

/* The part of the light of each row that is on a knot. */
void rl_light_on_knot(int knot, const double *light, int rows, double *part);

/* Products of the light on each two knots, of which the lower triangle is used, and with the
 * signal, for every walk.
 */
struct rl_knot_products {
    double normal[RL_KNOTS][RL_KNOTS][RL_WALK_LANES], right[RL_KNOTS][RL_WALK_LANES];
};

/* Least squares, for every walk.
 *
 * may_darken: whether gains may be negative
 * explained: becomes by how much the gains lower the squares
 */
void rl_knots_solve(const struct rl_knot_products *products, bool may_darken,
                    double gain[RL_KNOTS][RL_WALK_LANES], double explained[RL_WALK_LANES]);

#endif
