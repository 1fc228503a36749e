/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Gains that change: weights of their knots, and their least squares. */
#include "retrolidar_likelihood.h"

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

typedef double (*rl_matrix)[RL_KNOTS][RL_WALK_LANES];

/* Subtract products of two, of every walk. */
static void subtract(double *from, const double *a, const double *b)
{
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        from[walk] -= a[walk] * b[walk];
    }
}

static void divide(double *number, const double *by)
{
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        number[walk] /= by[walk];
    }
}

/* Solve symmetric positive systems in place, by Cholesky's factors, of their lower triangles. */
static void solve(rl_matrix matrix, double (*right)[RL_WALK_LANES])
{
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int j = 0; j < i; j++) {
            for (int k = 0; k < j; k++) {
                subtract(matrix[i][j], matrix[i][k], matrix[j][k]);
            }
            divide(matrix[i][j], matrix[j][j]);
        }
        for (int k = 0; k < i; k++) {
            subtract(matrix[i][i], matrix[i][k], matrix[i][k]);
        }
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double square = matrix[i][i][walk];
            matrix[i][i][walk] = sqrt(square > 1e-12 ? square : 1e-12);
        }
    }
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int k = 0; k < i; k++) {
            subtract(right[i], matrix[i][k], right[k]);
        }
        divide(right[i], matrix[i][i]);
    }
    for (int i = RL_KNOTS - 1; i >= 0; i--) {
        for (int k = i + 1; k < RL_KNOTS; k++) {
            subtract(right[i], matrix[k][i], right[k]);
        }
        divide(right[i], matrix[i][i]);
    }
}

double rl_gain_profile_at(const double gain[RL_KNOTS], int row, int rows)
{
    const struct between at = between_knots(row, knots_a_row(rows));
    return (1.0 - at.beyond) * gain[at.knot] + at.beyond * gain[at.knot + 1];
}

void rl_light_on_knot(int knot, const double *light, int rows, double *part)
{
    const double density = knots_a_row(rows);
    for (int row = 0; row < rows; row++) {
        const double away = fabs(row * density - knot);
        part[row] = away < 1.0 ? light[row] * (1.0 - away) : 0.0;
    }
}

/* Lay out the systems of the knots that are used; gains of others are zero. */
static void lay_out(const struct rl_knot_products *products, bool (*is_used)[RL_WALK_LANES],
                    rl_matrix matrix, double (*gain)[RL_WALK_LANES])
{
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            gain[i][walk] = is_used[i][walk] ? products->right[i][walk] : 0.0;
        }
        for (int j = 0; j <= i; j++) {
            for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                const bool is_both = is_used[i][walk] && is_used[j][walk];
                const double product = is_both ? products->normal[i][j][walk] : i == j;
                matrix[i][j][walk] = product * (i == j ? 1.0 + RIDGE : 1.0);
            }
        }
    }
}

/* Leave out the most negative gain of each walk; return whether there is any. */
static bool drop_negative(const double (*gain)[RL_WALK_LANES], bool (*is_used)[RL_WALK_LANES])
{
    bool is_any = false;
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        int worst = 0;
        for (int i = 1; i < RL_KNOTS; i++) {
            worst = gain[i][walk] < gain[worst][walk] ? i : worst;
        }
        if (gain[worst][walk] < 0.0) {
            is_used[worst][walk] = false;
            is_any = true;
        }
    }
    return is_any;
}

/* An active set: if gains may not be negative, the most negative one becomes zero until there is
 * none.
 */
void rl_knots_solve(const struct rl_knot_products *products, bool may_darken,
                    double gain[RL_KNOTS][RL_WALK_LANES], double explained[RL_WALK_LANES])
{
    double matrix[RL_KNOTS][RL_KNOTS][RL_WALK_LANES];
    bool is_used[RL_KNOTS][RL_WALK_LANES];
    for (int i = 0; i < RL_KNOTS; i++) {
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            is_used[i][walk] = products->normal[i][i][walk] > RL_NO_ENERGY;
        }
    }
    do {
        lay_out(products, is_used, matrix, gain);
        solve(matrix, gain);
    } while (!may_darken && drop_negative((const double (*)[RL_WALK_LANES])gain, is_used));
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        explained[walk] = 0.0;
        for (int i = 0; i < RL_KNOTS; i++) {
            explained[walk] += gain[i][walk] * products->right[i][walk];
        }
    }
}
