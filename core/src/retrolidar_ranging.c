/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_ranging.h"

#include "retrolidar_math.h"

#include <math.h>

enum { OWN = 1, DARK = 2, MIN_DISTANCES = 2 };

/* The marker is within the zone while the signal exceeds this share of this quantile. */
static const double IN_ZONE = 0.5, BRIGHTEST = 0.9;
/* The noise that the sensor is known for counts as so many samples: the fewest that give its
 * variance a mean (inverse gamma distribution).
 */
static const double PRIOR = 3.0;
static const double TWO_PI = 6.283185307179586;

/* A quantile of some values; it moves them. */
static double quantile(float *values, int count, double share)
{
    const double at = share * (count - 1);
    const int before = (int)at;
    const double low = (double)rl_select(values, count, before);
    double high = before + 1 < count ? INFINITY : low;
    for (int i = before + 1; i < count; i++) {
        high = fmin(high, (double)values[i]);
    }
    return low + (at - before) * (high - low);
}

/* Whether the sensor separated the background from the marker, so that it is no part of the pulse.
 * Near the limit it did if subtracting the background would put the marker beyond the limit.
 */
static bool is_apart(double wall_m, double depth_m, const struct rl_ranged *parted,
                     double separable_m)
{
    const double gap_m = fabs(wall_m - depth_m);
    const double beyond_m = fabs(wall_m - parted->depth_m) - 3 * sqrt(parted->variance);
    return gap_m >= separable_m || (gap_m >= separable_m - RL_UNSURE_M && beyond_m > separable_m);
}

double rl_chance_apart(double squared, double spread, double separable_m)
{
    const double mounted = exp(-squared / (2 * spread)) / sqrt(TWO_PI * spread);
    const double anywhere = 1 / (2 * separable_m);
    return anywhere / (mounted + anywhere);
}

/* Weight the distances with and without subtraction of the background by the likelihood of the step
 * between them: a background in the same pulse is mostly the marker's mounting, and then
 * subtracting it only adds noise.
 *
 * share: of the background in the signal while the marker is bright
 */
static void weigh(struct rl_ranged *plain, const struct rl_ranged *parted, double share,
                  double separable_m)
{
    const double step_m = parted->depth_m - plain->depth_m;
    const double noise = fmax(parted->variance - plain->variance, 0.0);
    const double mounting = RL_MOUNTING_M * share * RL_MOUNTING_M * share;
    const double spread = noise + mounting;
    const double chance = rl_chance_apart(step_m * step_m, spread, separable_m * share);
    const double near_m = plain->depth_m + step_m * mounting / spread;
    const double near_variance = plain->variance + noise * mounting / spread;
    const double apart_m = parted->depth_m - near_m;
    plain->depth_m = near_m + chance * apart_m;
    plain->variance = (1 - chance) * near_variance + chance * parted->variance +
                      chance * (1 - chance) * apart_m * apart_m;
}

/* How the marker moved while it was seen, along the line of sight. */
struct motion {
    double noise;    /* variance of a sample about its course */
    double bend_m;   /* from its mean distance to that at the mean time */
    double variance; /* of that; all zones share it */
};

/* Fit the motion of the marker to its distances, which `orthogonal` holds. If it bends, the mean is
 * not where the marker was at the mean time: the bend of a parabola counts by the odds that there
 * is one (Bayes factor). What successive samples have in common, as by other motion, adds to the
 * variance of the mean.
 *
 * expected: variance of a sample that the sensor is known for
 */
static struct motion motion_of(const struct rl_seen *seen, const uint8_t *role, double middle_s,
                               double expected)
{
    double count = 0.0, mean = 0.0, times = 1e-12, skew = 0.0, slope = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            count += 1.0;
            mean += seen->orthogonal[row];
            times += since_s * since_s;
            skew += since_s * since_s * since_s;
            slope += since_s * seen->orthogonal[row];
        }
    }
    mean /= count;
    slope /= times;
    skew /= times;
    /* `shape` is the squared time, made orthogonal to a line. */
    const double level = times / count;
    double energy = 1e-12, cross = 0.0, squares = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            const double shape = since_s * (since_s - skew) - level;
            const double off = seen->orthogonal[row] - mean - slope * since_s;
            energy += shape * shape;
            cross += shape * off;
            squares += off * off;
        }
    }
    const double left = fmax(squares - cross * cross / energy, 0.0);
    const double freedom = fmax(count - 3.0, 0.0) + PRIOR - 2.0;
    const double noise = fmax((left + PRIOR * expected) / freedom, 1e-12);
    const double any = RL_BEND_M_S2 * RL_BEND_M_S2 / 4.0;
    const double variance = 1.0 / (energy / noise + 1.0 / any);
    const double bend = variance * cross / noise;
    const double nats = (bend * bend / variance - log(any / variance)) / 2.0;
    const double chance = 1.0 / (1.0 + exp(-nats));
    double alike = 0.0, before = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            const double shape = since_s * (since_s - skew) - level;
            const double off =
                seen->orthogonal[row] - mean - slope * since_s - chance * bend * shape;
            alike += off * before;
            before = off;
        }
    }
    const double spread = chance * (variance + (1.0 - chance) * bend * bend);
    return (struct motion){.noise = noise,
                           .bend_m = -chance * bend * level,
                           .variance = spread * level * level + fmax(alike, 0.0) / count};
}

/* Mark the samples that the marker itself was seen in; return how many there are. */
static int mark_own(const struct rl_seen *seen, float *values, uint8_t *role)
{
    int count = 0, brightest = 0, own = 0;
    for (int row = 0; row < seen->rows; row++) {
        role[row] =
            seen->valid[row] && seen->light[row] > RL_BRIGHT && isfinite(seen->distance[row]);
        if (role[row]) {
            values[count++] = seen->signal[row];
        }
    }
    if (count == 0) {
        return 0;
    }
    /* A moving marker is within the zone for a part of the time only. With other markers beside it,
     * the signal does not show when.
     */
    const double least = seen->others > 0 ? 0.0 : IN_ZONE * quantile(values, count, BRIGHTEST);
    for (int row = 0; row < seen->rows; row++) {
        role[row] = role[row] && (double)seen->signal[row] > least;
        if (role[row]) {
            values[brightest++] = seen->distance[row];
        }
    }
    if (brightest == 0) {
        return 0;
    }
    const double about_m = (double)rl_select(values, brightest, brightest / 2);
    for (int row = 0; row < seen->rows; row++) {
        role[row] =
            role[row] && fabs((double)seen->distance[row] - about_m) < seen->sensor->separable_m;
        own += role[row];
    }
    return own;
}

bool rl_ranging(const struct rl_seen *seen, float *values, uint8_t *role, struct rl_ranged *ranged)
{
    const struct rl_sensor *sensor = seen->sensor;
    const int own = mark_own(seen, values, role);
    double depth_m = 0.0, time_s = 0.0, signal = 0.0, behind = 0.0;
    int dark = 0, walls = 0;
    if (own < MIN_DISTANCES) {
        return false;
    }
    for (int row = 0; row < seen->rows; row++) {
        depth_m += role[row] & OWN ? (double)seen->distance[row] / own : 0.0;
    }
    for (int row = 0; row < seen->rows; row++) {
        if (role[row] & OWN) {
            time_s += (seen->begin_s[row] + seen->end_s[row]) / 2 / own;
            signal += (double)seen->signal[row] / own;
        } else if (seen->valid[row] && seen->light[row] < (1.0 - RL_BRIGHT)) {
            /* A separated background is no part of the marker's pulse. */
            const double gap_m = fabs((double)seen->distance[row] - depth_m) -
                                 3.0 * sensor->ranging_shot / (double)seen->signal[row];
            role[row] = gap_m >= sensor->separable_m ? 0 : DARK;
            behind += role[row] ? (double)seen->signal[row] : 0.0;
            dark += role[row] != 0;
            if (isfinite(seen->distance[row])) {
                values[walls++] = seen->distance[row];
            }
        }
    }
    *ranged = (struct rl_ranged){depth_m, 0.0, time_s, 0.0};
    for (int row = 0; row < seen->rows; row++) {
        seen->orthogonal[row] = (double)seen->distance[row];
    }
    const double shot_m = sensor->ranging_shot / fmax(signal, 1e-3);
    const double expected = shot_m * shot_m + sensor->ranging_floor_m * sensor->ranging_floor_m;
    struct motion motion = motion_of(seen, role, time_s, expected);
    ranged->variance = motion.noise / own;
    struct rl_ranged parted;
    double others = 0.0;
    const bool blinks = dark > 0 && rl_blinking_range(seen, role, depth_m, &parted, &others);
    if (blinks && others > 0.0) {
        /* Their light shifts the mean of the distances, by up to `separable_m`. */
        ranged->variance += others * others * sensor->separable_m * sensor->separable_m / 3.0;
        if (parted.variance < ranged->variance) {
            *ranged = (struct rl_ranged){parted.depth_m, parted.variance, time_s, 0.0};
            motion = motion_of(seen, role, time_s, expected);
        }
    } else if (blinks && !(walls > 0 && is_apart(quantile(values, walls, 0.5), depth_m, &parted,
                                                 sensor->separable_m))) {
        weigh(ranged, &parted, fmax(behind / dark / fmax(signal, 1e-9), 1e-3), sensor->separable_m);
    }
    ranged->depth_m += motion.bend_m;
    ranged->common = motion.variance;
    /* Quantisation adds the variance of a uniform distribution. */
    ranged->variance += sensor->distance_step_m * sensor->distance_step_m / 12.0 / own;
    /* Noise may have put it out of range. */
    return ranged->depth_m > 0.0 && ranged->depth_m < sensor->max_distance_m;
}
