/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Start and bit period of a packet, found closely in a window. */
#ifndef RETROLIDAR_REFINE_H
#define RETROLIDAR_REFINE_H

#include "retrolidar_window.h"

/* Find the start and the bit period that are likeliest, near to those
 * given; return the log likelihood. The limits of the bit period are to be set before.
 *
 * half_bits: from the start to the middle of the window
 */
double rl_window_refine(struct rl_window *window, struct rl_transmission *transmission,
                        double half_bits);

#endif
