/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether a marker that is followed is still there, and still sends the same.
 *
 * In each frame the measured light is compared with the predicted one. A hidden Markov model
 * weights six explanations: as predicted; hidden; beside an unknown marker, which is dark or
 * bright; and sending other bits, dark or bright. A marker that stays unseen for too long is gone,
 * whatever hides it.
 */
#include "retrolidar_followed.h"

#include <math.h>
#include <string.h>

enum { SAME, HIDDEN, BESIDE_DARK, BESIDE_BRIGHT, OTHER_DARK, OTHER_BRIGHT };

/* Rates at which each begins and ends [1/s]. */
static const double HIDES = 0.1, SHOWS = 5.0, GAINS = 0.6, LOSES = 0.3, CHANGES = 0.03;
/* Error of the predicted light. */
static const double OFFSET = 0.05;
/* Likelihood of any light. */
static const double ANYTHING = 0.01;
/* Greatest light of an unknown marker, over that of this one. */
static const double MAX_MORE = 1.2;
/* A marker is gone after so many unseen bits; dark ones count a part: experiment `tracks`. */
static const double GONE_BITS = 12.0, GONE_STEP_BITS = 1.2, DARK_PART = 0.6;
static const double BRIGHT_LIGHT = 0.5, SEEN = 4.0; /* [nats] */
static const double MIN_CHANCE = 1e-9, MAX_STEP_S = 0.1;

void rl_presence_start(struct rl_presence *presence, double chance)
{
    memset(presence->chance, 0, sizeof presence->chance);
    presence->chance[SAME] = chance;
    presence->chance[OTHER_DARK] = presence->chance[OTHER_BRIGHT] = (1.0 - chance) / 2;
    presence->seen_nats = 0.0;
    presence->log_odds = log(chance / (1.0 - chance));
}

static double density(double value, double mean, double variance)
{
    const double off = value - mean;
    return exp(-off * off / variance / 2.0) / sqrt(6.283185307179586 * variance);
}

static void change(double chance[RL_EXPLANATIONS], const struct rl_glance *glance)
{
    const double step_s = fmin(glance->step_s, MAX_STEP_S);
    const double flips = 0.5 * fmin(step_s / glance->bit_s, 1.0);
    const double same = chance[SAME], hidden = chance[HIDDEN];
    const double beside_dark = chance[BESIDE_DARK], beside_bright = chance[BESIDE_BRIGHT];
    const double dark = chance[OTHER_DARK], bright = chance[OTHER_BRIGHT];
    chance[SAME] = same * (1.0 - (HIDES + GAINS + CHANGES) * step_s) +
                   (SHOWS * hidden + LOSES * (beside_dark + beside_bright)) * step_s;
    chance[HIDDEN] = hidden * (1.0 - SHOWS * step_s) + same * HIDES * step_s;
    chance[BESIDE_DARK] =
        beside_dark * (1.0 - LOSES * step_s) + flips * (beside_bright - beside_dark);
    chance[BESIDE_BRIGHT] = beside_bright * (1.0 - LOSES * step_s) +
                            flips * (beside_dark - beside_bright) + same * GAINS * step_s;
    chance[OTHER_DARK] = dark + flips * (bright - dark) + same * CHANGES * step_s / 2.0;
    chance[OTHER_BRIGHT] = bright + flips * (dark - bright) + same * CHANGES * step_s / 2.0;
}

static void weigh(double chance[RL_EXPLANATIONS], const struct rl_glance *glance)
{
    const double light = glance->light, seen = glance->measured;
    const double variance = glance->variance + OFFSET * OFFSET;
    const double less = fmin(glance->level, MAX_MORE); /* if the level was another's in part */
    const double more =
        seen > light - less && seen < light + MAX_MORE ? 1.0 / (less + MAX_MORE) : 0.0;
    const double same = density(seen, light, variance + glance->edge_variance) + ANYTHING;
    const double dark = density(seen, 0.0, variance) + ANYTHING;
    chance[SAME] *= same;
    chance[BESIDE_DARK] *= same;
    chance[BESIDE_BRIGHT] *= more + ANYTHING;
    chance[HIDDEN] *= dark;
    chance[OTHER_DARK] *= dark;
    chance[OTHER_BRIGHT] *= density(seen, 1.0, variance) + ANYTHING;
    double total = 0.0;
    for (int i = 0; i < RL_EXPLANATIONS; i++) {
        total += chance[i];
    }
    for (int i = 0; i < RL_EXPLANATIONS; i++) {
        chance[i] = fmax(chance[i] / total, MIN_CHANCE);
    }
}

/* Whether the light is seen, by the sum of the evidence since it was seen last (Page 1954). */
static bool see(struct rl_presence *presence, const struct rl_glance *glance)
{
    const double light = glance->light, off = glance->measured - light;
    const double variance = glance->variance + OFFSET * OFFSET + glance->edge_variance;
    if (light > BRIGHT_LIGHT && glance->measured < 1.0 + MAX_MORE) {
        const double nats = (glance->measured * glance->measured - off * off) / variance / 2.0;
        presence->seen_nats = fmax(presence->seen_nats + fmin(nats, 2.0 * SEEN), 0.0);
    }
    if (presence->seen_nats < SEEN) {
        return false;
    }
    presence->seen_nats = 0.0;
    return light > BRIGHT_LIGHT;
}

double rl_presence_doubt(const struct rl_presence *presence)
{
    return 1.0 - presence->chance[SAME] - presence->chance[HIDDEN];
}

bool rl_presence_update(struct rl_presence *presence, const struct rl_glance *glance)
{
    bool seen = false;
    change(presence->chance, glance);
    presence->unseen_bits +=
        glance->step_s / glance->bit_s * (glance->light > BRIGHT_LIGHT ? 1.0 : DARK_PART);
    if (isfinite(glance->variance)) {
        weigh(presence->chance, glance);
        seen = see(presence, glance);
        presence->unseen_bits = seen ? 0.0 : presence->unseen_bits;
    }
    const double *chance = presence->chance;
    const double gone = exp(fmin((presence->unseen_bits - GONE_BITS) / GONE_STEP_BITS, 700.0));
    const double others = chance[OTHER_DARK] + chance[OTHER_BRIGHT];
    const double other =
        others / (chance[SAME] + chance[HIDDEN] + chance[BESIDE_DARK] + chance[BESIDE_BRIGHT]);
    presence->log_odds = -log(gone + other);
    return seen;
}
