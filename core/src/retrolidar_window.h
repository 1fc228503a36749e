/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* A window of samples of one or more channels, and how well packets explain it. */
#ifndef RETROLIDAR_WINDOW_H
#define RETROLIDAR_WINDOW_H

#include "retrolidar_interference.h"
#include "retrolidar_likelihood.h"
#include "retrolidar_target.h"
#include "retrolidar_template.h"

struct rl_window {
    const struct rl_samples *samples;
    int max_rows;
    int first, rows; /* in the samples */
    int channels;
    int channel[RL_MAX_ZONES_TOGETHER];
    struct rl_whitened whitened[RL_MAX_ZONES_TOGETHER];
    struct rl_gain fit[RL_MAX_ZONES_TOGETHER]; /* of the template that was tried last */
    struct rl_interference interference;       /* of the windows that are opened from now on */
    double hidden_from_s, hidden_to_s;         /* exposures in between are left out */
    double min_bit_s, max_bit_s;               /* limits of a refinement */
    double null;                               /* log likelihood without a packet */
    double *light;                             /* of the template that was tried last */
    double *part;                              /* of the light of an interferer */
    double *seen;                              /* of the light, where the gain changes */
    double *profile[RL_MAX_ZONES_TOGETHER];    /* how the gain of a channel changes, 0 to 1 */
    bool has_profile[RL_MAX_ZONES_TOGETHER];   /* else it does not */
    uint8_t *valid;                            /* of the channel that is added */
    struct rl_room room;
};

int64_t rl_window_bytes(int rows);
void rl_window_start(struct rl_window *window, const struct rl_samples *samples, int rows,
                     void *memory);

/* Look at the exposures from one time to another, at first in one channel. */
void rl_window_open(struct rl_window *window, int channel, double from_s, double to_s);

/* Leave out the exposures from one time to another in all channels. */
void rl_window_hide(struct rl_window *window, double from_s, double to_s);

/* Look at another channel, too, if it is none of them and there is room; else do nothing. */
void rl_window_add(struct rl_window *window, int channel);

/* Look no longer at the channel that was added last. */
void rl_window_drop(struct rl_window *window);

/* Log likelihood of what is sent, each channel having its own gain, noise and wandering level. */
double rl_window_try(struct rl_window *window, const struct rl_transmission *transmission);

/* The same of what `light` holds, for every row. */
double rl_window_try_light(struct rl_window *window);

/* The same if the packet is seen from a row of the window on only, or until it, as if its marker
 * had appeared or vanished.
 */
double rl_window_try_part(struct rl_window *window, const struct rl_transmission *transmission,
                          int split, bool later);

/* The same of other bits in a stretch of time only. */
double rl_window_try_stretch(struct rl_window *window, const struct rl_transmission *transmission,
                             uint32_t bits, double from_s, double to_s);

/* The same of two lone packets, one of which follows the other, seen in a part of the window. */
double rl_window_try_two(struct rl_window *window, const struct rl_transmission *one,
                         const struct rl_transmission *other, int split, bool later);

/* The same of other bits. */
double rl_window_try_bits(struct rl_window *window, const struct rl_transmission *transmission,
                          uint32_t bits);

/* Let gains change from now on as the light of a packet does, where that explains more than it
 * costs: for whatever is tried in this window, as its rivals may move as it does. Return what it
 * costs [nats].
 */
double rl_window_follow_gain(struct rl_window *window, const struct rl_transmission *transmission);

/* Let gains no longer change. */
void rl_window_steady(struct rl_window *window);

#endif
