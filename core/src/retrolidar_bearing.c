/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_bearing.h"

#include <math.h>

enum { AXES = 2 };
/* Relative deviation of a known blur; and the weight of any other one, as a marker may move. */
static const double BLUR_DOUBT = 0.3, SMEARED = 1e-3;
/* Possible blur of a spot, as standard deviations in widths of a zone: it differs with the lens and
 * the sharpener's setting, and a moving marker blurs its own spot.
 */
static const double BLUR[RL_BLURS] = {0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35};
/* Number of places in each stretch, denser near edges of the zone, and the limits of these. */
enum { STRETCHES = 5 };
static const int PLACES[STRETCHES] = {5, 50, 40, 50, 5};
static const double FROM[STRETCHES + 1] = {-0.7, -0.6, -0.4, 0.4, 0.6, 0.7};
/* Share of the light by which a zone may deviate from the model. */
static const double MODEL_ERROR = 0.02;
static const double MIN_DOUBT = 1e-6; /* [kcps/SPAD] */
static const double SQRT_2 = 1.4142135623730951;
/* Places that are less likely than the likeliest by more are left out [nats]. */
static const double HOPELESS = 40.0;

/* Tabulate the shares of a point in the zones of a row; a larger marker is as a larger blur. */
static void share_out(struct rl_bearing_table *table)
{
    for (int blur = 0; blur < RL_BLURS; blur++) {
        for (int place = 0; place < RL_PLACES; place++) {
            double until = 0.0;
            for (int edge = 0; edge <= RL_NEAR; edge++) {
                const double distance = edge - RL_NEAR / 2.0 - table->place[place];
                const double light = erfc(-distance / BLUR[blur] / SQRT_2) / 2;
                if (edge > 0) {
                    table->share[blur][place][edge - 1] = light - until;
                }
                until = light;
            }
        }
    }
}

void rl_bearing_start(struct rl_bearing_table *table)
{
    int count = 0;
    for (int stretch = 0; stretch < STRETCHES; stretch++) {
        const double step = (FROM[stretch + 1] - FROM[stretch]) / PLACES[stretch];
        for (int i = 0; i < PLACES[stretch]; i++) {
            table->place[count++] = FROM[stretch] + i * step;
        }
    }
    table->place[count] = FROM[STRETCHES];
    for (int i = 0; i < RL_PLACES; i++) {
        const int before = i > 0 ? i - 1 : 0, after = i + 1 < RL_PLACES ? i + 1 : i;
        table->prior[i] = (table->place[after] - table->place[before]) / (after - before);
    }
    share_out(table);
}

/* How likely each place is, given each blur. The precision is 0 where there is no zone. */
static void believe(const struct rl_bearing_table *table, const double light[RL_NEAR],
                    const double precision[RL_NEAR], double belief[RL_BLURS][RL_PLACES])
{
    double most = 0.0;
    for (int blur = 0; blur < RL_BLURS; blur++) {
        for (int place = 0; place < RL_PLACES; place++) {
            const double *share = table->share[blur][place];
            double common = 0.0, energy = 1e-30;
            for (int i = 0; i < RL_NEAR; i++) {
                common += share[i] * light[i] * precision[i];
                energy += share[i] * share[i] * precision[i];
            }
            /* The amplitude that fits best is taken for each place. */
            belief[blur][place] = common > 0.0 ? common * common / energy / 2 : 0.0;
            most = fmax(most, belief[blur][place]);
        }
    }
    for (int blur = 0; blur < RL_BLURS; blur++) {
        for (int place = 0; place < RL_PLACES; place++) {
            const double less = belief[blur][place] - most;
            belief[blur][place] = less > -HOPELESS ? table->prior[place] * exp(less) : 0.0;
        }
    }
}

static double prior_of(double blur, double known)
{
    if (known > 0.0) {
        const double off = log(blur / known) / BLUR_DOUBT;
        return exp(-off * off / 2) + SMEARED;
    }
    /* With less blur fewer places light two zones; without this prior a large blur would win. */
    return 1.0 / sqrt(blur);
}

struct rl_bearing rl_bearing_of(const struct rl_bearing_table *table, int32_t rows, int32_t columns,
                                int32_t zone, const double *amplitude, const double *variance,
                                double blur)
{
    const int at[AXES] = {zone % columns, zone / columns}, most[AXES] = {columns, rows};
    const int apart[AXES] = {1, columns};
    const double doubt = fmax(MODEL_ERROR * amplitude[zone], MIN_DOUBT);
    struct rl_bearing bearing = {{0.0, 0.0}, {0.0, 0.0}};
    double belief[RL_BLURS][RL_PLACES];
    /* Neighbours across and down suffice: the shares of others are products of theirs. */
    for (int axis = 0; axis < AXES; axis++) {
        double light[RL_NEAR] = {0.0}, precision[RL_NEAR] = {0.0};
        for (int i = 0; i < RL_NEAR; i++) {
            const int other = zone + (i - 1) * apart[axis];
            if (at[axis] + i - 1 >= 0 && at[axis] + i - 1 < most[axis]) {
                light[i] = amplitude[other];
                precision[i] = 1.0 / (variance[other] + doubt * doubt);
            }
        }
        believe(table, light, precision, belief);
        double total = 0.0, sum = 0.0, square = 0.0;
        for (int i = 0; i < RL_BLURS; i++) {
            const double weight = prior_of(BLUR[i], blur);
            for (int place = 0; place < RL_PLACES; place++) {
                const double chance = weight * belief[i][place];
                const double at_place = table->place[place], step = table->prior[place];
                total += chance;
                sum += chance * at_place;
                square += chance * (at_place * at_place + step * step / 12.0);
            }
        }
        bearing.mean[axis] = sum / total;
        bearing.variance[axis] = square / total - bearing.mean[axis] * bearing.mean[axis];
    }
    return bearing;
}
