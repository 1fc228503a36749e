/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Distance of what blinks, of all that is merged in a zone.
 *
 * A target too near to the marker to be separated merges with it, and the distance reported is the
 * mean of both, weighted by signal. So signal times distance is a sum, of which the marker's part
 * is modulated, the background's is not, and that of another marker is modulated by its own bits:
 * the modulation of signal times distance over that of the signal is the distance of the marker
 * alone, both by least squares with the light of the other markers as further columns.
 */
#ifndef RETROLIDAR_BLINKING_RANGE_H
#define RETROLIDAR_BLINKING_RANGE_H

#include "retrolidar_ranging.h"

/* Make the light of the others, and then the marker's own, orthogonal to all before. Return the
 * energy of the latter.
 *
 * role: of each sample; those with 0 are not used
 */
double rl_orthogonalise(const struct rl_seen *seen, const uint8_t *role);

/* Find the distance of what blinks, from a first guess; false where nothing does. Then `alone` is
 * what is left over, over the gain [m].
 *
 * role: of each row, 0 if it is not used
 * others: share of the signal that is light of other markers, 0 unless they are seen
 */
bool rl_blinking_range(const struct rl_seen *seen, const uint8_t *role, double about_m,
                       struct rl_ranged *found, double *others);

#endif
