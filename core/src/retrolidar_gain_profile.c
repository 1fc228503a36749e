/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_gain_profile.h"

#include "retrolidar_constants.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>

/* What keeps the gain of a knot near to those beside it, as a share of the mean energy. */
static const double STIFFNESS = 0.02;

/* Which knot is the last one before a row, and how far beyond it the row is, 0 to 1. */
static int knot_of(int row, int rows, double *beyond)
{
    const double at = rows > 1 ? (double)row * (RL_KNOTS - 1) / (rows - 1) : 0.0;
    const int knot = at < RL_KNOTS - 1 ? (int)at : RL_KNOTS - 2;
    *beyond = at - knot;
    return knot;
}

/* Add the light of a row to the two knots around it; return the first of them. */
static int add_light(double column[RL_KNOTS], int row, int rows, double light)
{
    double beyond;
    const int knot = knot_of(row, rows, &beyond);
    column[knot] += (1.0 - beyond) * light;
    column[knot + 1] += beyond * light;
    return knot;
}

/* Solve a symmetric positive system in place, by Cholesky's factors. */
static void solve(double matrix[RL_KNOTS][RL_KNOTS], double right[RL_KNOTS])
{
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = matrix[i][j];
            for (int k = 0; k < j; k++) {
                sum -= matrix[i][k] * matrix[j][k];
            }
            matrix[i][j] = i == j ? sqrt(fmax(sum, 1e-12)) : sum / matrix[j][j];
        }
    }
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int k = 0; k < i; k++) {
            right[i] -= matrix[i][k] * right[k];
        }
        right[i] /= matrix[i][i];
    }
    for (int i = RL_KNOTS - 1; i >= 0; i--) {
        for (int k = i + 1; k < RL_KNOTS; k++) {
            right[i] -= matrix[k][i] * right[k];
        }
        right[i] /= matrix[i][i];
    }
}

/* Products of the light of the knots, their sums with the signal, and squares of it: of steps. */
struct sums {
    double normal[RL_KNOTS][RL_KNOTS], right[RL_KNOTS], total;
    int steps;
};

static struct sums sums_of(const float *signal, const uint8_t *valid, const double *light, int rows)
{
    struct sums sums = {.steps = 0};
    for (int row = 0, before = -1; row < rows; row++) {
        if (!valid[row]) {
            continue;
        }
        if (before >= 0) {
            double column[RL_KNOTS] = {0.0};
            const double step = (double)signal[row] - (double)signal[before];
            const int first = add_light(column, before, rows, -light[before]);
            const int last = add_light(column, row, rows, light[row]) + 1;
            for (int i = first; i <= last; i++) {
                for (int j = first; j <= last; j++) {
                    sums.normal[i][j] += column[i] * column[j];
                }
                sums.right[i] += column[i] * step;
            }
            sums.total += step * step;
            sums.steps++;
        }
        before = row;
    }
    return sums;
}

struct rl_gain_profile rl_gain_profile_fit(const float *signal, const uint8_t *valid,
                                           const double *light, int rows, double gain[RL_KNOTS])
{
    struct sums sums = sums_of(signal, valid, light, rows);
    double right[RL_KNOTS], energy = 0.0, all = 0.0, common = 0.0, explained = 0.0;
    memcpy(right, sums.right, sizeof right);
    for (int i = 0; i < RL_KNOTS; i++) {
        energy += sums.normal[i][i] / RL_KNOTS;
        common += right[i];
        for (int j = 0; j < RL_KNOTS; j++) {
            all += sums.normal[i][j];
        }
    }
    for (int i = 0; i < RL_KNOTS; i++) {
        const double stiff = STIFFNESS * energy + 1e-9;
        sums.normal[i][i] += (i > 0 && i + 1 < RL_KNOTS ? 2.0 : 1.0) * stiff;
        if (i > 0) {
            sums.normal[i][i - 1] -= stiff;
            sums.normal[i - 1][i] -= stiff;
        }
    }
    solve(sums.normal, right);
    for (int i = 0; i < RL_KNOTS; i++) {
        explained += right[i] * sums.right[i];
    }
    /* Several gains take a part of whatever is there besides; so they must be worth it. */
    const double steady = all > 0.0 ? common * common / all : 0.0;
    const double changed = fmax(sums.total - explained, 1e-12);
    const double worth = 0.5 * sums.steps * log((sums.total - steady) / changed);
    const bool changes = worth > RL_COST_OF_GAIN * (RL_KNOTS - 1);
    for (int i = 0; i < RL_KNOTS; i++) {
        gain[i] = changes ? right[i] : all > 0.0 ? common / all : 0.0;
    }
    /* A marker that happens to begin with another one has its preamble, too. */
    const double price =
        2.0 * RL_COST_OF_CHANCE + (changes ? RL_COST_OF_GAIN * (RL_KNOTS - 1) : 0.0);
    const double taken = changes ? explained : steady;
    const double left = fmax((sums.total - taken) / fmax(sums.steps, 1.0), 1e-12);
    return (struct rl_gain_profile){taken / (2.0 * left) - price, common, all};
}

double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows)
{
    double beyond;
    const int knot = knot_of(row, rows, &beyond);
    return (1.0 - beyond) * gain[knot] + beyond * gain[knot + 1];
}
