/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Markers that are followed: clock, light in each zone, range and bearing of each. */
#ifndef RETROLIDAR_FOLLOWED_H
#define RETROLIDAR_FOLLOWED_H

#include "retrolidar_samples.h"
#include "retrolidar_template.h"
#include "retrolidar_tracks.h"

enum { RL_EXPLANATIONS = 6 };

/* Whether a marker is still there, and still sends the same. */
struct rl_presence {
    double chance[RL_EXPLANATIONS];
    double seen_nats;   /* evidence that its light is there, since it was seen last */
    double unseen_bits; /* since it was seen last; dark bits count a part */
    double log_odds;    /* that it is there, and sends the same [nats] */
};

/* Begin, or begin anew: only the time since it was seen is kept. chance: that it continues as
 * predicted
 */
void rl_presence_start(struct rl_presence *presence, double chance);

/* What a frame shows of a marker. */
struct rl_glance {
    double step_s, bit_s;
    double light;         /* as predicted, 0 to 1 */
    double measured;      /* light, over that of a bright marker */
    double variance;      /* of that; infinite if no zone is valid */
    double level;         /* of the zone, in the same unit; another marker may be a part of it */
    double edge_variance; /* of the predicted light, by the error of the clock */
    bool crossed;         /* whether the zones' shares have changed: it has crossed an edge */
};

/* The probability that there is light of another marker. */
double rl_presence_doubt(const struct rl_presence *presence);

/* Return whether its light was seen. */
bool rl_presence_update(struct rl_presence *presence, const struct rl_glance *glance);

enum { RL_MOTIONS = 4 };

/* Range and range rate, with their covariance. */
struct rl_motion {
    double range_m, rate;                   /* [m], [m/s] */
    double variance, common, rate_variance; /* of the range, of both, of the rate */
};

/* Ways in which a marker may move along the line of sight, and their probabilities. */
struct rl_range_filter {
    double chance[RL_MOTIONS];
    struct rl_motion motion[RL_MOTIONS];
};

void rl_range_start(struct rl_range_filter *filter, double range_m, double variance);

void rl_range_predict(struct rl_range_filter *filter, double step_s);

/* Update with a measured range; share: its derivative with respect to the marker's range. */
void rl_range_update(struct rl_range_filter *filter, double range_m, double variance, double share);

/* The mean and the covariance over all motions. */
struct rl_motion rl_range_estimate(const struct rl_range_filter *filter);

/* What a zone sees of a marker: a level that wanders, and a gain of its light. */
struct rl_zone_light {
    double level, gain; /* [kcps/SPAD] */
    double level_variance, common, gain_variance;
    double excess; /* residual variance over that of noise, more than 1 in other light */
};

/* A sample of a zone, less the light of other markers. */
struct rl_zone_sample {
    bool valid;
    double signal, variance; /* [kcps/SPAD] */
};

/* Weighted sums of light and signal, to which level and gain are fitted. */
struct rl_zone_sums {
    double count, weight, light, signal, squares, cross, power;
};

void rl_zone_add(struct rl_zone_sums *sums, const struct rl_zone_sample *sample, double light);
struct rl_zone_light rl_zone_fit(const struct rl_zone_sums *sums);

/* Widen the variances, as the marker may have moved meanwhile, so that the newest samples count.
 * Zones that have not read it see nothing of it: their gain is the light of another marker.
 */
void rl_zone_doubt(struct rl_zone_light *lights, int zones, const struct rl_reading *reading);

/* The zone that sees most of a marker, among one and those beside it. */
int rl_zone_strongest(const struct rl_zone_light *lights, const struct rl_samples *held, int near);

/* Whether a zone, the strongest or one beside it, is sure to see a part of the marker. */
bool rl_zone_sees(const struct rl_zone_light *lights, const struct rl_samples *held, int zone,
                  int strongest);

/* Measure the light of a marker in the strongest zone and those beside it. */
void rl_zone_measure(const struct rl_zone_light *lights, const struct rl_samples *held,
                     const struct rl_zone_sample *samples, int strongest,
                     struct rl_glance *glance);

/* Let time pass. crossed: the probability that the marker crosses the view */
void rl_zone_predict(struct rl_zone_light *lights, const struct rl_samples *held, int strongest,
                     double step_s, double crossed);

/* Update all zones with samples of the predicted light. */
void rl_zone_update(struct rl_zone_light *lights, const struct rl_samples *held,
                    const struct rl_zone_sample *samples, int strongest,
                    const struct rl_glance *glance);

/* Light falls with the range by this power (paper Fig. 5a). */
static const double RL_EXPONENT = -3.8;

/* What a zone sees while the marker is dark: its distance behind the marker, and the precision. */
struct rl_background {
    double offset_m, precision; /* [m], [1/m^2] */
};

/* An error of the marker's clock that is corrected: of the start, and of the bit period. */
struct rl_clock_error {
    double variance, common, rate_variance; /* [s^2], [s], of the rate */
};

struct rl_followed {
    uint16_t id;
    struct rl_transmission transmission;
    struct rl_clock_error clock;
    struct rl_presence presence;
    struct rl_range_filter range;
    struct rl_zone_light zone[RL_MAX_ZONES];
    struct rl_background behind[RL_MAX_ZONES];
    double light, slope;         /* in the newest frame, and how it changes with the start [1/s] */
    double noise_scale;          /* variance of distances over the law */
    double bias_variance;        /* of the range, by what is behind or beside the marker [m^2] */
    double distance_m, distance_s; /* the last one in the strongest zone ... */
    double distance_variance;
    int distance_zone;
    double ranged_s;                /* when the range was measured last */
    int off_scale;                  /* successive bright frames with another light */
    int strongest;                  /* zone, when it was seen last */
    int bright_frames;              /* since the bearing was found ... */
    double amplitude[RL_MAX_ZONES]; /* ... and the gains then */
    struct rl_bearing bearing;
    double shared_s; /* when gains were found last */
    double crossed;  /* chance that it moves across the view */
    double first_s;
    int64_t last_ns;
};

/* The row to which markers are followed, and the light of the others there. */
struct rl_scenery {
    const struct rl_samples *samples;
    const struct rl_bearing_table *table;
    int row;
    double step_s; /* since the frame before */
    /* Light of other markers in each zone, its variance, and the sum of it times their ranges. */
    double other[RL_MAX_ZONES], other_variance[RL_MAX_ZONES], other_product[RL_MAX_ZONES];
};

/* The middle of the row's exposure [s]. */
static inline double rl_scenery_now(const struct rl_scenery *scenery)
{
    const struct rl_samples *samples = scenery->samples;
    return (samples->begin_s[scenery->row] + samples->end_s[scenery->row]) / 2;
}

/* The zone that sees most of it: the last one that did, or one beside that, as markers cross zones
 * one by one.
 */
static inline int rl_followed_strongest(const struct rl_followed *followed,
                                        const struct rl_samples *samples)
{
    return rl_zone_strongest(followed->zone, samples, followed->strongest);
}

/* The chance that it is lost: it was not seen for long. */
double rl_followed_lost(const struct rl_followed *followed);

/* Begin with a packet that was read. */
void rl_followed_start(struct rl_followed *followed, const struct rl_reading *reading);

/* Predict clock, light and place of the row. */
void rl_followed_predict(struct rl_followed *followed, const struct rl_scenery *scenery);

/* The sample of a zone, of the target that may be the marker. */
struct rl_zone_sample rl_followed_sample(const struct rl_followed *followed,
                                         const struct rl_scenery *scenery, int zone);

/* Take a row of the reading, whose light is known. */
void rl_followed_replay(struct rl_followed *followed, const struct rl_scenery *scenery,
                        double light);

/* Update the range by the strongest zone. */
void rl_followed_range(struct rl_followed *followed, const struct rl_scenery *scenery);

/* Find the bearing, if gains have changed. */
void rl_followed_bearing(struct rl_followed *followed, const struct rl_scenery *scenery);

/* Update all. */
void rl_followed_update(struct rl_followed *followed, const struct rl_scenery *scenery);

/* All that are followed, and how one begins. */
struct rl_tracks {
    struct rl_detector *detector;
    struct rl_track_counts counts;
    int count;
    struct rl_followed track[RL_MAX_TRACKS + 1]; /* and one that begins */
    int64_t origin_ns, last_ns; /* of the samples, and of the newest frame */
    struct rl_scenery scenery;
    double *light; /* room for a window */
};

/* Look at a row, in which there is no light of other markers yet. */
void rl_tracks_go_to(struct rl_tracks *tracks, int row, double since_s);

/* Add the light of a marker in the row, or take it off. */
void rl_tracks_add_light(struct rl_scenery *scenery, const struct rl_followed *followed,
                         double light, double sign);

/* Whether a marker is likely to be there still, and where the sensor sees. */
bool rl_tracks_is_there(const struct rl_followed *followed);

/* Begin with a reading, in the place behind the last track; return whether it is one. */
bool rl_tracks_begin(struct rl_tracks *tracks, const struct rl_reading *reading);

#endif
