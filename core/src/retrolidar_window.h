/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A window of samples of a channel, and how well packets explain it. */
#ifndef RETROLIDAR_WINDOW_H
#define RETROLIDAR_WINDOW_H

#include "retrolidar_likelihood.h"
#include "retrolidar_target.h"
#include "retrolidar_template.h"

enum { RL_KNOTS = RL_PARTS - 1 };

/* What a gain that changes must explain besides a steady one [nats]. */
static inline double rl_price_of_profile(void)
{
    return RL_COST_OF_GAIN * (RL_KNOTS - 1);
}

struct rl_gain_profile {
    double nats;          /* log likelihood ratio of the steps against no light, less its price */
    /* Sums over the steps: of the signal with the light, and of the light squared. Their ratio is
     * the steady gain.
     */
    double cross, energy;
};

/* Fit a gain that is linear between RL_KNOTS knots, equally spaced over the rows. It is fitted to
 * the steps from row to row, which a wandering level changes little.
 *
 * light: of the packet in each row
 */
struct rl_gain_profile rl_gain_profile_fit(const float *signal, const uint8_t *valid,
                                           const double *light, int rows, double gain[RL_KNOTS]);

/* The gain in a row. */
double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows);

struct rl_window {
    const struct rl_samples *samples;
    int first, rows; /* in the samples */
    const double *begin_s, *end_s; /* of each exposure [s] */
    int channel;
    bool is_dimmer; /* whether the marker is the dimmer one of two targets */
    struct rl_column column;             /* samples of that target ... */
    struct rl_whitened whitened;         /* ... and whitened */
    struct rl_gain fit;                  /* of the template that was tried last */
    struct rl_interference interference; /* trains in the windows that are opened next ... */
    int reference;                       /* ... and a zone that interferes, or RL_NO_REFERENCE */
    double min_bit_s, max_bit_s;         /* limits of a refinement */
    double *light;                       /* of the template that was tried last */
    double *part;                        /* of the light of an interferer */
    double *seen;                        /* light times profile */
    double *profile;                     /* gain of each row over the greatest, 0 to 1 */
    bool has_profile;                    /* whether the gain changes */
    struct rl_room room;
};

void rl_window_start(struct rl_window *window, const struct rl_samples *samples,
                     struct rl_memory *memory);

/* Open the exposures of a channel from one time to another, and whiten them. */
void rl_window_open(struct rl_window *window, int channel, bool is_dimmer, double from_s,
                    double to_s);

/* Log likelihood of a transmission. */
double rl_window_try(struct rl_window *window, const struct rl_transmission *transmission);

/* The same of the template that `light` holds. */
double rl_window_try_light(struct rl_window *window);

/* The same if the marker appears in a row of the window (`later`), or vanishes there. */
double rl_window_try_part(struct rl_window *window, const struct rl_transmission *transmission,
                          int split, bool later);

/* The same if other bits are sent in a stretch of time. */
double rl_window_try_stretch(struct rl_window *window, const struct rl_transmission *transmission,
                             uint32_t bits, double from_s, double to_s);

/* The same of two lone packets, one of which follows the other. */
double rl_window_try_two(struct rl_window *window, const struct rl_transmission *one,
                         const struct rl_transmission *other);

/* Find the start and the bit period that are likeliest, near to those given; return the log
 * likelihood. The limits of the bit period are to be set before.
 *
 * half_bits: from the start to the middle of the window
 */
double rl_window_refine(struct rl_window *window, struct rl_transmission *transmission,
                        double half_bits);

/* Fit the gain of a packet along with that of any other. */
void rl_window_add(struct rl_window *window, const struct rl_transmission *transmission);

/* Fit a changing gain to a packet. If it explains more than it costs, all that is tried in this
 * window has it from now on, as rivals may move, too. Return the cost [nats].
 */
double rl_window_follow_gain(struct rl_window *window, const struct rl_transmission *transmission);

#endif
