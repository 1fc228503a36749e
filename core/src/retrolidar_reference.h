/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Adaptive interference cancelling (Widrow et al. 1975): a zone beside sees what interferes, too,
 * and more of it. Its signal stands for light of which neither ID nor clock need be known.
 */
#ifndef RETROLIDAR_REFERENCE_H
#define RETROLIDAR_REFERENCE_H

#include "retrolidar_target.h"

enum { RL_NO_REFERENCE = -1 };

/* What a zone sees in some rows beyond its darkest. */
void rl_reference_light(const struct rl_samples *samples, int zone, int first, int rows,
                        double *light);

/* Erase the samples of a column in whose rows the reference has none. */
void rl_reference_erase(const struct rl_samples *samples, int zone, int first, int rows,
                        struct rl_room *room, struct rl_column *column);

#endif
