/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_likelihood.h"

#include <math.h>
#include <string.h>

/* Whiten a template as the signal was, and find its products with itself and with the signal. The
 * first sample only sets the level. Return the first sample that differs from it; the column is 0
 * before.
 */
static int whiten_template(const struct rl_whitened *whitened, const double *light,
                           double (*column)[RL_WALK_LANES], double power[RL_WALK_LANES],
                           double cross[RL_WALK_LANES])
{
    double level[RL_WALK_LANES] = {0.0}, squares[RL_WALK_LANES] = {0.0};
    double products[RL_WALK_LANES] = {0.0};
    const double first = light[whitened->row[0]];
    int from = 1;
    while (from < whitened->samples && light[whitened->row[from]] == first) {
        from++;
    }
    memset(column, 0, (size_t)from * sizeof *column);
    for (int sample = from; sample < whitened->samples; sample++) {
        const double value = light[whitened->row[sample]] - first;
        const double *gain = whitened->gain[sample], *scale = whitened->scale[sample];
        const double *signal = whitened->signal[sample];
        double white[RL_WALK_LANES];
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double innovation = value - level[walk];
            white[walk] = innovation * scale[walk];
            level[walk] += gain[walk] * innovation;
            products[walk] += white[walk] * signal[walk];
            squares[walk] += white[walk] * white[walk];
        }
        memcpy(column[sample], white, sizeof white);
    }
    memcpy(power, squares, sizeof squares);
    memcpy(cross, products, sizeof products);
    return from;
}

/* Products of two whitened columns from a sample on, for every walk. */
static void multiply(const double (*a)[RL_WALK_LANES], const double (*b)[RL_WALK_LANES], int from,
                     int samples, double product[RL_WALK_LANES])
{
    memset(product, 0, RL_WALK_LANES * sizeof *product);
    for (int sample = from; sample < samples; sample++) {
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            product[walk] += a[sample][walk] * b[sample][walk];
        }
    }
}

/* Subtract so many times another column from one. */
static void subtract(double (*from)[RL_WALK_LANES], const double (*column)[RL_WALK_LANES],
                     int samples, const double times[RL_WALK_LANES])
{
    for (int sample = 1; sample < samples; sample++) {
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            from[sample][walk] -= times[walk] * column[sample][walk];
        }
    }
}

typedef const double (*rl_const_column)[RL_WALK_LANES];

void rl_add_interferer(struct rl_whitened *whitened, const double *light)
{
    const int samples = whitened->samples;
    double (*column)[RL_WALK_LANES] = whitened->interferer[whitened->interferers];
    double power[RL_WALK_LANES], product[RL_WALK_LANES], scale[RL_WALK_LANES];
    if (samples < 3) {
        return;
    }
    whiten_template(whitened, light, column, power, product);
    for (int i = 0; i < whitened->interferers; i++) {
        rl_const_column other = (rl_const_column)whitened->interferer[i];
        multiply((rl_const_column)column, other, 1, samples, product);
        subtract(column, other, samples, product);
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            power[walk] -= product[walk] * product[walk];
        }
    }
    multiply((rl_const_column)column, (rl_const_column)whitened->signal, 1, samples, product);
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        scale[walk] = power[walk] > RL_NO_ENERGY ? 1.0 / sqrt(power[walk]) : 0.0;
        product[walk] *= scale[walk];
        whitened->squares[walk] -= product[walk] * product[walk];
    }
    for (int sample = 1; sample < samples; sample++) {
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            column[sample][walk] *= scale[walk];
        }
    }
    subtract(whitened->signal, (rl_const_column)column, samples, product);
    whitened->interferers++;
    rl_find_null(whitened);
}

/* The best of all walks, by how much a fit lowers the squares of each and by which gain. */
static struct rl_gain best_of(const struct rl_whitened *whitened, int parameters,
                              const double explained[RL_WALK_LANES],
                              const double gain[RL_WALK_LANES])
{
    struct rl_gain best = {whitened->null, 0.0, 0};
    for (int walk = 0; walk < RL_WALKS; walk++) {
        if (explained[walk] > 0.0) {
            const double squares = fmax(whitened->squares[walk] - explained[walk], 0.0);
            const double likelihood = rl_log_likelihood(whitened, walk, squares, parameters);
            if (likelihood > best.log_likelihood) {
                best = (struct rl_gain){likelihood, gain[walk], walk};
            }
        }
    }
    return best;
}

struct rl_gain rl_fit_gain(const struct rl_whitened *whitened, const double *light,
                           bool may_darken)
{
    double (*column)[RL_WALK_LANES] = whitened->interferer[whitened->interferers];
    double power[RL_WALK_LANES], cross[RL_WALK_LANES];
    double explained[RL_WALK_LANES] = {0.0}, gain[RL_WALK_LANES] = {0.0};
    if (whitened->samples < 3) {
        return (struct rl_gain){whitened->null, 0.0, 0};
    }
    const int from = whiten_template(whitened, light, column, power, cross);
    for (int i = 0; i < whitened->interferers; i++) {
        double shared[RL_WALK_LANES];
        multiply((rl_const_column)column, (rl_const_column)whitened->interferer[i], from,
                 whitened->samples, shared);
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            power[walk] -= shared[walk] * shared[walk];
        }
    }
    for (int walk = 0; walk < RL_WALKS; walk++) {
        if ((may_darken || cross[walk] > 0.0) && power[walk] > RL_NO_ENERGY) {
            explained[walk] = cross[walk] * cross[walk] / power[walk];
            gain[walk] = cross[walk] / power[walk];
        }
    }
    return best_of(whitened, 1, explained, gain);
}

/* Find the products of the light on each knot, less what interferers explain of them. */
static void multiply_knots(const struct rl_whitened *whitened, const double *light, int rows,
                           double *part, struct rl_knot_products *products)
{
    double shared[RL_KNOTS][RL_MAX_INTERFERERS][RL_WALK_LANES];
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        double (*column)[RL_WALK_LANES] = whitened->interferer[whitened->interferers + knot];
        rl_light_on_knot(knot, light, rows, part);
        const int from = whiten_template(whitened, part, column, products->normal[knot][knot],
                                         products->right[knot]);
        for (int i = 0; i < whitened->interferers + knot; i++) {
            double *product = i < whitened->interferers
                                  ? shared[knot][i]
                                  : products->normal[knot][i - whitened->interferers];
            multiply((rl_const_column)column, (rl_const_column)whitened->interferer[i], from,
                     whitened->samples, product);
        }
        for (int other = 0; other <= knot; other++) {
            for (int i = 0; i < whitened->interferers; i++) {
                for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                    products->normal[knot][other][walk] -=
                        shared[knot][i][walk] * shared[other][i][walk];
                }
            }
        }
    }
}

struct rl_gain rl_fit_knots(const struct rl_whitened *whitened, const double *light, int rows,
                            bool may_darken, double *part, double gains[RL_KNOTS])
{
    struct rl_knot_products products;
    double gain[RL_KNOTS][RL_WALK_LANES];
    double explained[RL_WALK_LANES] = {0.0}, mean[RL_WALK_LANES] = {0.0};
    if (whitened->samples >= 3) {
        multiply_knots(whitened, light, rows, part, &products);
        rl_knots_solve(&products, may_darken, gain, explained);
        for (int walk = 0; walk < RL_WALKS; walk++) {
            for (int i = 0; i < RL_KNOTS; i++) {
                const double share = i > 0 && i < RL_KNOTS - 1 ? 1.0 : 2.0;
                mean[walk] += gain[i][walk] / share / (RL_KNOTS - 1);
            }
        }
    }
    const struct rl_gain best = best_of(whitened, RL_KNOTS, explained, mean);
    for (int i = 0; i < RL_KNOTS; i++) {
        gains[i] = best.log_likelihood > whitened->null ? gain[i][best.walk] : 0.0;
    }
    return best;
}
