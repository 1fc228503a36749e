/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What zones show without the packets that have been read in them: there, fainter ones are found
 * (successive interference cancellation).
 */
#ifndef RETROLIDAR_RESIDUAL_H
#define RETROLIDAR_RESIDUAL_H

#include "retrolidar_window.h"

struct rl_residual {
    struct rl_samples *samples;
    struct rl_room room;
    double *light[2], *part; /* of a marker that has ended, and that goes on */
    float *saved; /* signals of each channel before */
    int first;    /* row from which they were saved */
};

void rl_residual_start(struct rl_residual *residual, struct rl_samples *samples,
                       struct rl_memory *memory);

/* Subtract transmissions from the samples of a zone since a time. Return how the rest varies over
 * the newest rows, a packet's length of them, in the variance of noise.
 */
double rl_residual_subtract(struct rl_residual *residual, int zone,
                            const struct rl_interference *interference, double from_s);

/* Subtract what another zone sees, as far as that explains the zone. Return the same. */
double rl_residual_cancel(struct rl_residual *residual, int zone, int reference, double from_s);

/* The same of a sum of zones, once transmissions are subtracted from its zones. */
double rl_residual_sum(struct rl_residual *residual, int channel);

/* Put the samples of a channel back. */
void rl_residual_restore(struct rl_residual *residual, int channel);

#endif
