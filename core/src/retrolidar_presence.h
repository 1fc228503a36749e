/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Whether a marker that is followed is still there, and still sends the same.
 *
 * Each frame the light that was seen is held against the light that was predicted. A hidden Markov
 * model weighs six explanations: as predicted; hidden; beside another marker, dark or bright, that
 * is unknown; and of other bits, dark or bright. What stays unseen for too long is gone, whatever
 * hides it.
 */
#ifndef RETROLIDAR_PRESENCE_H
#define RETROLIDAR_PRESENCE_H

enum { RL_EXPLANATIONS = 6 };

struct rl_presence {
    double chance[RL_EXPLANATIONS];
    double seen_nats;   /* that its light is there, since it was last known to be */
    double unseen_bits; /* since then, of dark ones a part */
    double log_odds;    /* that it is there, and the same [nats] */
};

/* chance: that it goes on as predicted */
void rl_presence_start(struct rl_presence *presence, double chance);

/* Forget what was found out, but when it was seen. */
void rl_presence_restart(struct rl_presence *presence, double chance);

/* What a frame has shown. */
struct rl_glance {
    double step_s, bit_s;
    double light;         /* as predicted, 0 to 1 */
    double measured;      /* over that of a bright marker */
    double variance;      /* of that; infinite if nothing was seen */
    double level;         /* of the zone, likewise: what another marker may have been a part of */
    double edge_variance; /* of the light as predicted, by when its edges come */
};

/* The chance that there is light of another marker. */
double rl_presence_doubt(const struct rl_presence *presence);

/* Return whether its light was seen. */
int rl_presence_update(struct rl_presence *presence, const struct rl_glance *glance);

#endif
