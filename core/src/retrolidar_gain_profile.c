/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_gain_profile.h"

#include <math.h>

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
