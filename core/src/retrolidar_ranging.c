/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_ranging.h"

#include "retrolidar_math.h"

#include <math.h>

enum { OWN = 1, DARK = 2, MIN_DISTANCES = 2 };

/* A zone sees the marker while its signal has this share of that at this quantile. */
static const double IN_ZONE = 0.5, BRIGHTEST = 0.9;
static const double TWO_PI = 6.283185307179586;

/* The value that a share of some values are below, which it moves. */
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

/* Whether the background was separated from the marker, and so is no part of its pulse. Near the
 * limit it is if subtracting it would put the marker beyond the limit.
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

/* Where it is open whether a background need be subtracted: in the same pulse it is mostly what the
 * marker is mounted on, and then subtracting it only adds noise. So both hypotheses are weighted by
 * the step between the two distances.
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
    double bend_m;   /* from the mean to where it was at the mean time */
    double variance; /* of that, which zones have in common */
};

/* What `alone` of the samples of the marker says about its motion: a bend from a line, as then the
 * mean is not where the marker was at the mean time; and what samples have in common with the ones
 * before, by which the mean is off. Both only if they explain what a parameter costs.
 */
static struct motion motion_of(const struct rl_seen *seen, const uint8_t *role, double middle_s)
{
    double count = 0.0, mean = 0.0, times = 1e-12, skew = 0.0, slope = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            count += 1.0;
            mean += seen->alone[row];
            times += since_s * since_s;
            skew += since_s * since_s * since_s;
            slope += since_s * seen->alone[row];
        }
    }
    mean /= count;
    slope /= times;
    skew /= times;
    /* The square of the time less a line. */
    const double level = times / count;
    double energy = 1e-12, curve = 0.0, squares = 1e-30;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            const double bend = since_s * (since_s - skew) - level;
            const double off = seen->alone[row] - mean - slope * since_s;
            energy += bend * bend;
            curve += bend * off;
            squares += off * off;
        }
    }
    const double explained = curve * curve / energy / squares;
    const bool bends = (count - 2.0) * explained / 2.0 > RL_COST_OF_GAIN;
    curve = bends ? curve / energy : 0.0;
    double alike = 0.0, before = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - middle_s;
        if (role[row] & OWN) {
            const double bend = since_s * (since_s - skew) - level;
            const double off = seen->alone[row] - mean - slope * since_s - curve * bend;
            alike += off * before;
            before = off;
        }
    }
    squares *= bends ? 1.0 - explained : 1.0;
    struct motion motion = {.noise = squares / fmax(count - (bends ? 3.0 : 2.0), 1.0)};
    if (bends) {
        motion.bend_m = -curve * level;
        motion.variance = motion.noise * level * level / energy;
    }
    /* A correlation has to explain what a parameter costs. */
    const double correlation = fmax(alike / squares, 0.0);
    if (count * correlation * correlation / 2.0 > RL_COST_OF_GAIN) {
        motion.variance += alike / count;
    }
    return motion;
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
    /* A moving marker is in the zone for a part of the time only; of one beside others, that is not
     * to be seen in the signal.
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
            /* What is apart from the marker is no part of its pulse. */
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
        seen->alone[row] = (double)seen->distance[row];
    }
    struct motion motion = motion_of(seen, role, time_s);
    ranged->variance = motion.noise / own;
    struct rl_ranged parted;
    double others = 0.0;
    const bool blinks = dark > 0 && rl_blinking_range(seen, role, depth_m, &parted, &others);
    if (blinks && others > 0.0) {
        /* Their light is in the mean of the distances, too, from anywhere that merges. */
        ranged->variance += others * others * sensor->separable_m * sensor->separable_m / 3.0;
        if (parted.variance < ranged->variance) {
            *ranged = (struct rl_ranged){parted.depth_m, parted.variance, time_s, 0.0};
            motion = motion_of(seen, role, time_s);
        }
    } else if (blinks && !(walls > 0 && is_apart(quantile(values, walls, 0.5), depth_m, &parted,
                                                 sensor->separable_m))) {
        weigh(ranged, &parted, fmax(behind / dark / fmax(signal, 1e-9), 1e-3), sensor->separable_m);
    }
    ranged->depth_m += motion.bend_m;
    ranged->common = motion.variance;
    /* Quantisation adds the variance of a uniform distribution. */
    ranged->variance += sensor->distance_step_m * sensor->distance_step_m / 12.0 / own;
    /* Noise may put it beyond. */
    return ranged->depth_m > 0.0 && ranged->depth_m < sensor->max_distance_m;
}
