/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_gain_profile.h"

#include <math.h>
#include <string.h>

/* Weight that keeps neighbouring knots alike, as a share of the mean energy. */
static const double STIFFNESS = 0.02;
/* Share of its energy that is added to each knot, as two may have the same light. */
static const double RIDGE = 1e-6;

/* The position of a row between two knots. */
struct between {
    int knot;
    double beyond; /* that knot, 0 to 1 */
};

static struct between between_knots(int row, double density)
{
    const double at = row * density;
    const int knot = at < RL_KNOTS - 1 ? (int)at : RL_KNOTS - 2;
    return (struct between){knot, at - knot};
}

static double knots_a_row(int rows)
{
    return rows > 1 ? (RL_KNOTS - 1.0) / (rows - 1) : 0.0;
}

/* Solve a symmetric positive system in place, by Cholesky's factors, of its lower triangle. */
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

/* Normal equations of the gains of all knots, and the sum of squares of the signal, of the steps
 * from row to row. A row has its light on the two knots around it.
 */
struct sums {
    double normal[RL_KNOTS][RL_KNOTS], right[RL_KNOTS], total;
    int steps;
};

static struct sums sums_of(const float *signal, const uint8_t *valid, const double *light, int rows)
{
    struct sums sums = {.steps = 0};
    const double density = knots_a_row(rows);
    double on[2] = {0.0, 0.0}; /* light of the row before on its knots, from `first` on */
    for (int row = 0, before = -1, first = 0; row < rows; row++) {
        if (!valid[row]) {
            continue;
        }
        const struct between now = between_knots(row, density);
        const double after = now.beyond * light[row];
        if (before >= 0) {
            double column[RL_KNOTS] = {-on[0], -on[1]};
            const double step = (double)signal[row] - (double)signal[before];
            const int last = now.knot + 1 - first;
            column[last - 1] += light[row] - after;
            column[last] += after;
            for (int i = 0; i <= last; i++) {
                for (int j = 0; j <= i; j++) {
                    sums.normal[first + i][first + j] += column[i] * column[j];
                }
                sums.right[first + i] += column[i] * step;
            }
            sums.total += step * step;
            sums.steps++;
        }
        on[0] = light[row] - after;
        on[1] = after;
        first = now.knot;
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
        for (int j = 0; j <= i; j++) {
            all += (j < i ? 2.0 : 1.0) * sums.normal[i][j];
        }
    }
    for (int i = 0; i < RL_KNOTS; i++) {
        const double stiff = STIFFNESS * energy + 1e-9;
        sums.normal[i][i] += (i > 0 && i + 1 < RL_KNOTS ? 2.0 : 1.0) * stiff;
        if (i > 0) {
            sums.normal[i][i - 1] -= stiff;
        }
    }
    solve(sums.normal, right);
    for (int i = 0; i < RL_KNOTS; i++) {
        explained += right[i] * sums.right[i];
    }
    /* Many gains also fit what is not of this marker, so they must explain more than they cost. */
    const double steady = all > 0.0 ? common * common / all : 0.0;
    const double changed = fmax(sums.total - explained, 1e-12);
    const double worth = 0.5 * sums.steps * log((sums.total - steady) / changed);
    const bool changes = worth > rl_price_of_profile();
    for (int i = 0; i < RL_KNOTS; i++) {
        gain[i] = changes ? right[i] : all > 0.0 ? common / all : 0.0;
    }
    /* A marker that begins at the time of another one has the same preamble. */
    const double price = 2.0 * RL_COST_OF_CHANCE + (changes ? rl_price_of_profile() : 0.0);
    const double taken = changes ? explained : steady;
    const double left = fmax((sums.total - taken) / fmax(sums.steps, 1.0), 1e-12);
    return (struct rl_gain_profile){taken / (2.0 * left) - price, common, all};
}

double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows)
{
    const struct between at = between_knots(row, knots_a_row(rows));
    return (1.0 - at.beyond) * gain[at.knot] + at.beyond * gain[at.knot + 1];
}

double rl_knot_weight(int knot, int row, int rows)
{
    return fmax(1.0 - fabs(row * knots_a_row(rows) - knot), 0.0);
}

/* An active set: if gains may not be negative, the most negative one becomes zero until there is
 * none.
 */
double rl_knots_solve(double normal[RL_KNOTS][RL_KNOTS], const double right[RL_KNOTS],
                      bool may_darken, double gain[RL_KNOTS])
{
    bool is_used[RL_KNOTS];
    for (int i = 0; i < RL_KNOTS; i++) {
        is_used[i] = normal[i][i] > RL_NO_ENERGY;
    }
    for (int worst = 0; worst >= 0;) {
        double matrix[RL_KNOTS][RL_KNOTS];
        for (int i = 0; i < RL_KNOTS; i++) {
            gain[i] = is_used[i] ? right[i] : 0.0;
            for (int j = 0; j <= i; j++) {
                matrix[i][j] = is_used[i] && is_used[j] ? normal[i][j] : i == j;
            }
            matrix[i][i] *= 1.0 + RIDGE;
        }
        solve(matrix, gain);
        worst = -1;
        for (int i = 0; i < RL_KNOTS; i++) {
            if (!may_darken && gain[i] < 0.0 && (worst < 0 || gain[i] < gain[worst])) {
                worst = i;
            }
        }
        if (worst >= 0) {
            is_used[worst] = false;
        }
    }
    double explained = 0.0;
    for (int i = 0; i < RL_KNOTS; i++) {
        explained += gain[i] * right[i];
    }
    return explained;
}
