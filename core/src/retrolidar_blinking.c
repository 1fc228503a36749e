/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Fits of the light that blinks, among all that is merged in a zone: how bright it is, and how far.
 *
 * A target too near to the marker to be separated merges with it, and the sensor reports the mean
 * of both distances, weighted by signal. So signal times distance is a sum. The marker's part of it
 * is modulated by its bits, the background's is constant, another marker's is modulated by other
 * bits. The distance of the marker alone is the modulation of that sum over the modulation of the
 * signal. Both are fitted by least squares, with the light of the other markers as further columns.
 */
#include "retrolidar_ranging.h"

#include <math.h>
#include <string.h>

static const double NO_BLINKING = 1e-9; /* least energy of light that blinks */

/* Signal times distance from a depth. */
static double product_of(const struct rl_seen *seen, int row, double from_m)
{
    const double distance = (double)seen->distance[row];
    return isfinite(distance) ? (double)seen->signal[row] * (distance - from_m) : 0.0;
}

/* Subtract the mean of the samples that have a role from light, and set all others to 0. */
static void centre(const uint8_t *role, int rows, double *light)
{
    double mean = 0.0, count = 1e-9;
    for (int row = 0; row < rows; row++) {
        mean += role[row] ? light[row] : 0.0;
        count += role[row] != 0;
    }
    for (int row = 0; row < rows; row++) {
        light[row] = role[row] ? light[row] - mean / count : 0.0;
    }
}

static double product(const double *a, const double *b, int rows)
{
    double sum = 0.0;
    for (int row = 0; row < rows; row++) {
        sum += a[row] * b[row];
    }
    return sum;
}

/* Subtract the projection on the light of another marker from a column. */
static void subtract(const double *other, int rows, double *column)
{
    const double energy = fmax(product(other, other, rows), NO_BLINKING);
    const double share = product(other, column, rows) / energy;
    for (int row = 0; row < rows; row++) {
        column[row] -= share * other[row];
    }
}

/* Make the light of the others, and then the marker's own, orthogonal to all before it, over the
 * samples that have a role. Return the energy of the marker's own.
 */
static double orthogonalise(const struct rl_seen *seen, const uint8_t *role)
{
    const int rows = seen->rows;
    memcpy(seen->orthogonal, seen->light, (size_t)rows * sizeof *seen->orthogonal);
    for (int i = 0; i <= seen->others; i++) {
        double *light = i < seen->others ? seen->other + i * rows : seen->orthogonal;
        centre(role, rows, light);
        for (int before = 0; before < i; before++) {
            subtract(seen->other + before * rows, rows, light);
        }
    }
    return product(seen->orthogonal, seen->orthogonal, rows);
}

/* How bright the others are in a zone. */
struct brightness {
    double gain[RL_MAX_OTHERS], min_gain[RL_MAX_OTHERS]; /* a greater gain is not noise */
    double signal;                                       /* mean, of all light */
};

/* Fit the light of the others to the signal; gain: of the marker itself. */
static struct brightness brightness_of(const struct rl_seen *seen, const uint8_t *role, double gain)
{
    double count = 1e-9, total = 0.0, sum = 0.0, squares = 0.0;
    double cross[RL_MAX_OTHERS] = {0.0}, energy[RL_MAX_OTHERS];
    for (int row = 0; row < seen->rows; row++) {
        const double left = role[row] ? (double)seen->signal[row] - gain * seen->light[row] : 0.0;
        count += role[row] != 0;
        total += role[row] ? (double)seen->signal[row] : 0.0;
        sum += left;
        squares += left * left;
        for (int i = 0; i < seen->others; i++) {
            cross[i] += seen->other[i * seen->rows + row] * left;
        }
    }
    squares -= sum * sum / count;
    for (int i = 0; i < seen->others; i++) {
        const double *other = seen->other + i * seen->rows;
        energy[i] = fmax(product(other, other, seen->rows), NO_BLINKING);
        squares -= cross[i] * cross[i] / energy[i];
    }
    const double noise = fmax(squares, 0.0) / fmax(count - 2.0, 1.0);
    struct brightness found = {.signal = total / count};
    for (int i = 0; i < seen->others; i++) {
        found.gain[i] = cross[i] / energy[i];
        found.min_gain[i] = RL_MIN_SEEN * sqrt(noise / energy[i]);
    }
    return found;
}

/* The share of the signal that is light of others that are seen; gain: of the marker itself. */
static double share_of_others(const struct rl_seen *seen, const uint8_t *role, double gain)
{
    const struct brightness found = brightness_of(seen, role, gain);
    double share = 0.0;
    for (int i = 0; i < seen->others; i++) {
        /* About half of its bits are bright. */
        share += found.gain[i] > found.min_gain[i] ? found.gain[i] / 2 : 0.0;
    }
    return share / fmax(found.signal, 1e-9);
}

bool rl_last_other_is_seen(const struct rl_seen *seen)
{
    const double energy = fmax(orthogonalise(seen, seen->valid), NO_BLINKING);
    double gain = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        gain += seen->orthogonal[row] * (double)seen->signal[row] / energy;
    }
    const struct brightness found = brightness_of(seen, seen->valid, gain);
    return found.gain[seen->others - 1] > found.min_gain[seen->others - 1];
}

bool rl_blinking_range(const struct rl_seen *seen, const uint8_t *role, double about_m,
                       struct rl_ranged *found, double *others)
{
    const int rows = seen->rows;
    const double energy = orthogonalise(seen, role);
    double gain = 0.0, count = 0.0, from_m = about_m, slope = 0.0, mean = 0.0, squares = 0.0;
    for (int row = 0; row < rows; row++) {
        gain += seen->orthogonal[row] * (double)seen->signal[row];
        count += role[row] != 0;
    }
    if (!(energy > NO_BLINKING) || !(gain > 0.0)) {
        return false;
    }
    gain /= energy;
    *others = share_of_others(seen, role, gain);
    /* Distances are taken from the marker, so that noise of the signal does not count. The first
     * round finds about where it is; the residual of the second gives the variance.
     */
    for (int round = 0; round < 2; round++) {
        from_m = about_m;
        slope = mean = 0.0;
        for (int row = 0; row < rows; row++) {
            const double product_m = role[row] ? product_of(seen, row, from_m) : 0.0;
            slope += seen->orthogonal[row] * product_m / energy;
            mean += product_m / count;
        }
        about_m += slope / gain;
    }
    for (int row = 0; row < rows; row++) {
        const double product_m = role[row] ? product_of(seen, row, from_m) - mean : 0.0;
        seen->orthogonal[row] = product_m - slope * seen->orthogonal[row];
    }
    for (int i = 0; i < seen->others; i++) {
        subtract(seen->other + i * rows, rows, seen->orthogonal);
    }
    for (int row = 0; row < rows; row++) {
        squares += seen->orthogonal[row] * seen->orthogonal[row];
        seen->orthogonal[row] /= gain;
    }
    found->depth_m = about_m;
    /* Two columns, and two more, as the noise of few samples may be larger (Student 1908). */
    found->variance = squares / fmax(count - 4, 1) / energy / (gain * gain);
    return true;
}

/* Slope of the signal over light whose mean is 0. */
static double rise_with(const struct rl_seen *seen, const double *light)
{
    double cross = 0.0, energy = 1e-9;
    for (int row = 0; row < seen->rows; row++) {
        cross += light[row] * (double)seen->signal[row];
        energy += light[row] * light[row];
    }
    return cross / energy;
}

void rl_fit_amplitude(const struct rl_samples *samples, const struct rl_seen *seen, int zone,
                      struct rl_amplitude *amplitude)
{
    double of_other[RL_MAX_OTHERS], count = 0.0, signal = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        count += seen->valid[row];
        signal += seen->valid[row] ? (double)seen->signal[row] : 0.0;
    }
    signal /= fmax(count, 1.0);
    /* A hand that passes gives a zone without a target a few samples, which any gain fits. Fewer
     * than the bits in which words differ tell none.
     */
    const bool is_known = count >= RL_WORD_DISTANCE;
    const double energy = fmax(is_known ? orthogonalise(seen, seen->valid) : 0.0, 1e-9);
    const double rise = is_known ? rise_with(seen, seen->orthogonal) : 0.0;
    for (int i = 0; i < seen->others; i++) {
        of_other[i] = is_known ? rise_with(seen, seen->other + i * seen->rows) : 0.0;
    }
    double power = 0.0, alike = 0.0, before = 0.0, dark = 0.0, sum = 0.0, squares = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        double left = (double)seen->signal[row] - signal - rise * seen->orthogonal[row];
        for (int i = 0; i < seen->others; i++) {
            left -= of_other[i] * seen->other[i * seen->rows + row];
        }
        left = seen->valid[row] ? left : 0.0;
        power += left * left;
        alike += left * before;
        before = left;
        if (seen->valid[row] && seen->light[row] < 1.0 - RL_BRIGHT) {
            dark += 1.0;
            sum += left;
            squares += left * left;
        }
    }
    /* The residual may be another marker, whose samples are correlated. The noise is at least that
     * of the sensor's quantisation.
     */
    const double step = seen->sensor->signal_step;
    const double noise = fmax(power / fmax(count - 2.0, 1.0), step * step / 12.0);
    const double known = rl_noise_variance(samples, zone, signal);
    const double of_dark =
        fmax(dark > 2.0 ? (squares - sum * sum / dark) / (dark - 1.0) : noise, known);
    amplitude->of[zone] = rise;
    amplitude->noise[zone] = noise;
    amplitude->unknown[zone] = sqrt((of_dark - known) * count / energy);
    amplitude->score[zone] = fmax(rise, 0.0) / sqrt(rise * rise + power / energy + 1e-30);
    const double samples_alike = 1.0 + 2.0 * fmax(alike / fmax(power, 1e-9), 0.0);
    amplitude->variance[zone] = noise * samples_alike / energy;
    amplitude->dark_variance[zone] = of_dark * samples_alike / energy;
}
