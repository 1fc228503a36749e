/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_likelihood.h"

#include <math.h>
#include <string.h>

/* The last lane repeats the one before it, to fill vectors of two. */
static const double Q_OVER_R[RL_WALK_LANES] = {0.0, 0.003, 0.01, 0.03, 0.1,
                                               0.3, 1.0,   3.0,  30.0, 30.0};

void rl_whitened_start(struct rl_whitened *whitened, int rows, struct rl_memory *memory)
{
    memset(whitened, 0, sizeof *whitened);
    whitened->gain = rl_take(memory, rows, sizeof *whitened->signal);
    whitened->scale = rl_take(memory, rows, sizeof *whitened->signal);
    whitened->signal = rl_take(memory, rows, sizeof *whitened->signal);
    for (int i = 0; i < RL_MAX_INTERFERERS + RL_KNOTS; i++) {
        whitened->interferer[i] = rl_take(memory, rows, sizeof *whitened->signal);
    }
    whitened->row = rl_take(memory, rows, sizeof(int));
}

static double log_likelihood(const struct rl_whitened *whitened, int walk, double squares,
                             int parameters, double *variance)
{
    const double innovations = whitened->samples - 1;
    parameters += whitened->interferers;
    *variance = fmax(squares / fmax(innovations - parameters, 1.0), whitened->least);
    return -0.5 * innovations * log(*variance) - 0.5 * squares / *variance +
           whitened->log_scales[walk];
}

static void find_null(struct rl_whitened *whitened)
{
    double ignored;
    whitened->null = -INFINITY;
    for (int walk = 0; walk < RL_WALKS; walk++) {
        const double one = log_likelihood(whitened, walk, whitened->squares[walk], 0, &ignored);
        if (one > whitened->null) {
            whitened->null = one;
            whitened->null_walk = walk;
        }
    }
}

void rl_whiten(struct rl_whitened *whitened, const float *signal, const uint8_t *valid,
               const double *begin_s, const double *end_s, int rows, double period_s, double least)
{
    double variance[RL_WALK_LANES], level[RL_WALK_LANES], product[RL_WALK_LANES];
    double squares[RL_WALK_LANES] = {0.0};
    double last_s = 0.0, first = 0.0;
    int samples = 0;
    whitened->least = least;
    whitened->interferers = 0;
    whitened->explained = 0.0;
    memset(whitened->log_scales, 0, sizeof whitened->log_scales);
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        variance[walk] = product[walk] = 1.0;
        level[walk] = 0.0;
    }
    for (int row = 0; row < rows; row++) {
        if (!valid[row]) {
            continue;
        }
        const double value = signal[row];
        const double middle_s = (begin_s[row] + end_s[row]) / 2;
        const double periods = (middle_s - last_s) / period_s;
        double *gain = whitened->gain[samples], *scale = whitened->scale[samples];
        double *white = whitened->signal[samples];
        whitened->row[samples] = row;
        last_s = middle_s;
        if (samples++ == 0) {
            /* The level is unknown, so the first sample only sets it. */
            first = value;
            for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                gain[walk] = scale[walk] = white[walk] = 0.0;
            }
            continue;
        }
        for (int walk = 0; walk < RL_WALK_LANES; walk++) {
            const double predicted = variance[walk] + Q_OVER_R[walk] * periods;
            const double per_total = 1.0 / (predicted + 1.0);
            const double innovation = value - first - level[walk];
            gain[walk] = predicted * per_total;
            scale[walk] = sqrt(per_total);
            white[walk] = innovation * scale[walk];
            squares[walk] += white[walk] * white[walk];
            level[walk] += gain[walk] * innovation;
            variance[walk] = gain[walk];
            product[walk] *= per_total;
        }
        if (samples % 16 == 0) {
            for (int walk = 0; walk < RL_WALK_LANES; walk++) {
                whitened->log_scales[walk] += 0.5 * log(product[walk]);
                product[walk] = 1.0;
            }
        }
    }
    whitened->samples = samples;
    for (int walk = 0; walk < RL_WALK_LANES; walk++) {
        whitened->log_scales[walk] += 0.5 * log(product[walk]);
        whitened->squares[walk] = squares[walk];
    }
    find_null(whitened);
}

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
    const double before = whitened->null;
    find_null(whitened);
    whitened->explained += whitened->null - before;
}

struct rl_gain rl_fit_gain(const struct rl_whitened *whitened, const double *light,
                           bool may_darken)
{
    double (*column)[RL_WALK_LANES] = whitened->interferer[whitened->interferers];
    double power[RL_WALK_LANES], cross[RL_WALK_LANES];
    struct rl_gain best = {whitened->null, 0.0, whitened->least, 0};
    if (whitened->samples < 3) {
        return best;
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
        if (!(may_darken || cross[walk] > 0.0) || !(power[walk] > RL_NO_ENERGY)) {
            continue;
        }
        double variance;
        const double explained = cross[walk] * cross[walk] / power[walk];
        const double squares = fmax(whitened->squares[walk] - explained, 0.0);
        const double likelihood = log_likelihood(whitened, walk, squares, 1, &variance);
        if (likelihood > best.log_likelihood) {
            best = (struct rl_gain){likelihood, cross[walk] / power[walk], variance, walk};
        }
    }
    return best;
}

/* Products of the light on each knot, for every walk, less what interferers explain of them. */
struct knot_products {
    double normal[RL_KNOTS][RL_KNOTS][RL_WALK_LANES], right[RL_KNOTS][RL_WALK_LANES];
};

static void multiply_knots(const struct rl_whitened *whitened, const double *light, int rows,
                           double *part, struct knot_products *products)
{
    double shared[RL_KNOTS][RL_MAX_INTERFERERS][RL_WALK_LANES];
    for (int knot = 0; knot < RL_KNOTS; knot++) {
        double (*column)[RL_WALK_LANES] = whitened->interferer[whitened->interferers + knot];
        for (int row = 0; row < rows; row++) {
            part[row] = light[row] * rl_knot_weight(knot, row, rows);
        }
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
    struct knot_products products;
    struct rl_gain best = {whitened->null, 0.0, whitened->least, 0};
    memset(gains, 0, RL_KNOTS * sizeof *gains);
    if (whitened->samples < 3) {
        return best;
    }
    multiply_knots(whitened, light, rows, part, &products);
    for (int walk = 0; walk < RL_WALKS; walk++) {
        double normal[RL_KNOTS][RL_KNOTS], right[RL_KNOTS], gain[RL_KNOTS], variance, mean = 0.0;
        for (int i = 0; i < RL_KNOTS; i++) {
            right[i] = products.right[i][walk];
            for (int j = 0; j <= i; j++) {
                normal[i][j] = products.normal[i][j][walk];
            }
        }
        const double explained = rl_knots_solve(normal, right, may_darken, gain);
        const double squares = fmax(whitened->squares[walk] - explained, 0.0);
        const double likelihood = log_likelihood(whitened, walk, squares, RL_KNOTS, &variance);
        for (int i = 0; i < RL_KNOTS; i++) {
            mean += gain[i] / (i > 0 && i < RL_KNOTS - 1 ? 1.0 : 2.0) / (RL_KNOTS - 1);
        }
        if (explained > 0.0 && likelihood > best.log_likelihood) {
            best = (struct rl_gain){likelihood, mean, variance, walk};
            memcpy(gains, gain, sizeof gain);
        }
    }
    return best;
}

void rl_unwhiten(const struct rl_whitened *whitened, float *signal)
{
    const int walk = whitened->null_walk;
    double level = 0.0;
    if (whitened->samples == 0) {
        return;
    }
    const double first = (double)signal[whitened->row[0]];
    for (int sample = 1; sample < whitened->samples; sample++) {
        const double innovation = whitened->signal[sample][walk] / whitened->scale[sample][walk];
        signal[whitened->row[sample]] = (float)(first + level + innovation);
        level += whitened->gain[sample][walk] * innovation;
    }
}

double rl_excess_variance(const struct rl_whitened *whitened, const struct rl_gain *fit)
{
    const double q = Q_OVER_R[fit->walk];
    /* Variance of innovations over that of noise, in the filter's steady state. */
    const double innovation = 1.0 + (q + sqrt(q * q + 4.0 * q)) / 2.0;
    return fit->variance * innovation / whitened->least;
}
