/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* When and where the marker of a reading is, from what all zones saw of it. */
#include "retrolidar_detector_state.h"

#include <math.h>

/* Any packet explains this share of another one's light, as all begin with the preamble. */
static const double ALIKE = (double)RL_PREAMBLE_BITS / RL_PACKET_BITS;

/* The times of the samples of a reading, and the light of its packet at each. */
static struct rl_seen window_of(struct rl_detector *detector, const struct rl_verdict *verdict,
                                int *first)
{
    const struct rl_samples *samples = &detector->samples;
    /* An exposure that is mostly outside may show the packet before or after. */
    const double overlap_s = (1.0 - RL_BRIGHT) * samples->period_s;
    *first = rl_samples_row(samples, verdict->begin_s + overlap_s);
    int last = *first;
    while (last < samples->count && samples->begin_s[last] < verdict->end_s - overlap_s) {
        last++;
    }
    const struct rl_seen seen = {
        .sensor = &samples->sensor,
        .rows = last - *first,
        .begin_s = samples->begin_s + *first,
        .end_s = samples->end_s + *first,
        .light = detector->window.light,
        .orthogonal = detector->window.part,
        .other = detector->other,
    };
    rl_template(&verdict->transmission, seen.begin_s, seen.end_s, seen.rows,
                detector->window.light);
    return seen;
}

/* Take the samples of a zone, of the target that may be the marker. */
static void look_at(struct rl_detector *detector, const struct rl_verdict *verdict,
                    struct rl_seen *seen, int first, int zone)
{
    const struct rl_column column =
        rl_target_column(&detector->samples, zone, first, seen->rows, verdict->is_dimmer,
                         &detector->window.room);
    seen->valid = column.valid;
    seen->signal = column.signal;
    seen->distance = detector->samples.distance + rl_sample(&detector->samples, zone, first);
}

/* Find the light of other markers that were read in a zone or beside it at the time, if it is seen
 * in the zone.
 */
static void lay_others(const struct rl_detector *detector, const struct rl_verdict *verdict,
                       int zone, struct rl_seen *seen)
{
    const struct rl_pool *pool = &detector->pool;
    seen->others = 0;
    for (int i = pool->count - 1; i >= 0 && seen->others < RL_MAX_OTHERS; i--) {
        const struct rl_active_track *track = &pool->track[i];
        if (track->id != verdict->id && (track->near >> zone & 1u) != 0 &&
            track->train.end_s > verdict->begin_s && track->train.begin_s < verdict->end_s) {
            rl_train_light(&track->train, seen->begin_s, seen->end_s, seen->rows,
                           seen->other + seen->others++ * seen->rows);
            if (!rl_last_other_is_seen(seen)) {
                seen->others--;
            }
        }
    }
}

/* Whether a zone is one of a reading, or next to its strongest. */
static bool is_near(const struct rl_samples *samples, const struct rl_reading *reading, int zone)
{
    for (int i = 0; i < reading->zones; i++) {
        if (reading->zone[i] == zone) {
            return true;
        }
    }
    return rl_zone_beside(zone, reading->zone[0], samples->sensor.columns);
}

/* The gain of a zone beyond three deviations, and what may be of another marker that is not known.
 */
static double certain_gain(const struct rl_amplitude *amplitude, int zone, double variance)
{
    return amplitude->of[zone] - RL_MIN_SEEN * sqrt(variance) - ALIKE * amplitude->unknown[zone];
}

/* List the zones that surely saw the packet, sorted by their gain. */
static void choose_zones(const struct rl_samples *samples, const struct rl_reading *reading,
                         const struct rl_amplitude *amplitude, struct rl_placement *placement)
{
    double certain[RL_MAX_ZONES] = {0.0}, most = 0.0;
    for (int zone = 0; zone < samples->zones; zone++) {
        if (is_near(samples, reading, zone)) {
            certain[zone] = certain_gain(amplitude, zone, amplitude->variance[zone]);
            most = fmax(most, certain[zone]);
        }
    }
    placement->zones = 0;
    for (int zone = 0; zone < samples->zones; zone++) {
        const bool has_part = certain[zone] > 0.0 && amplitude->of[zone] >= RL_MIN_PART * most;
        if (has_part || zone == reading->zone[0]) {
            rl_add_zone(placement->zone, &placement->zones, zone, amplitude->of);
        }
    }
}

/* Variance of all distances that a zone measured. */
static double spread_of(const struct rl_seen *seen)
{
    double count = 0.0, sum = 0.0, squares = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        const double distance = (double)seen->distance[row];
        if (isfinite(distance)) {
            count += 1.0;
            sum += distance;
            squares += distance * distance;
        }
    }
    return fmax(squares - sum * sum / count, 0.0) / count;
}

/* Find the range in each of the zones that has one; return how many there are. */
static int range_zones(struct rl_detector *detector, const struct rl_reading *reading,
                       struct rl_seen *seen, int first, const struct rl_amplitude *amplitude,
                       const struct rl_placement *placement, struct rl_ranged *ranged)
{
    int found = 0;
    for (int i = 0; i < placement->zones; i++) {
        const int zone = placement->zone[i];
        look_at(detector, &reading->verdict, seen, first, zone);
        /* A distance is of all the light that comes back. */
        seen->signal = detector->samples.signal + rl_sample(&detector->samples, zone, first);
        lay_others(detector, &reading->verdict, zone, seen);
        if (rl_ranging(seen, detector->values, detector->role, &ranged[found])) {
            /* The sensor projects by the factor of the zone, not of the target. */
            const double z_per_range = seen->sensor->z_per_range[zone];
            const double square = z_per_range * z_per_range;
            ranged[found].depth_m /= z_per_range;
            /* If it did not surely see the packet for a time at least, that is of anything. */
            const double variance = amplitude->dark_variance[zone];
            const bool is_seen = certain_gain(amplitude, zone, variance) > 0.0;
            ranged[found].variance += is_seen ? 0.0 : spread_of(seen);
            ranged[found].variance /= square;
            ranged[found].common /= square;
            found++;
        }
    }
    return found;
}

/* The mean of the ranges of the zones, weighted by one over the variance. What crosses zones is
 * farther in the outer ones, so the variance rises with the time since the surest one.
 */
static bool combine(struct rl_ranged *ranged, int found, struct rl_placement *placement)
{
    double precision = 0.0, range_m = 0.0, squares = 0.0, time_s = 0.0, common = INFINITY;
    int surest = 0;
    if (found == 0) {
        return false;
    }
    for (int i = 1; i < found; i++) {
        surest = ranged[i].variance < ranged[surest].variance ? i : surest;
    }
    for (int i = 0; i < found; i++) {
        const double since_s = ranged[i].time_s - ranged[surest].time_s;
        const double bend_m = RL_BEND_M_S2 * since_s * since_s / 2.0;
        const double weight = 1.0 / (ranged[i].variance + bend_m * bend_m);
        precision += weight;
        common = fmin(common, ranged[i].common);
        range_m += weight * ranged[i].depth_m;
        squares += weight * ranged[i].depth_m * ranged[i].depth_m;
        time_s += weight * ranged[i].time_s;
    }
    placement->range_m = range_m / precision;
    /* If zones differ by more than their variances, that is the variance (Birge 1932). */
    const double spread = (squares - range_m * range_m / precision) / fmax(found - 1, 1);
    placement->range_variance = fmax(spread, 1.0) / precision + common;
    placement->time_s = time_s / precision;
    return true;
}

/* The paper's l, equations of its section 3.5, of the first whole preamble in the window. */
static double likelihood_of(const struct rl_seen *seen, const struct rl_verdict *verdict)
{
    const struct rl_transmission *transmission = &verdict->transmission;
    double level = 0.0, bright = 0.0, cross = 0.0, energy = 0.0, squares = 0.0;
    double start_s = transmission->start_s;
    start_s += start_s < verdict->begin_s ? RL_PACKET_BITS * transmission->bit_s : 0.0;
    for (int row = 0; row < seen->rows; row++) {
        if (seen->light[row] > RL_BRIGHT) {
            level += (double)seen->signal[row];
            bright += 1.0;
        }
    }
    level /= fmax(bright, 1.0);
    for (int row = 0; row < seen->rows; row++) {
        const double since_s = (seen->begin_s[row] + seen->end_s[row]) / 2 - start_s;
        if (since_s > 0.0 && since_s < RL_PREAMBLE_BITS * transmission->bit_s && seen->valid[row]) {
            const double dark = 1.0 - seen->light[row];
            const double signal = (double)seen->signal[row] - level;
            cross += dark * signal;
            energy += dark * dark;
            squares += signal * signal;
        }
    }
    const double coefficient = cross / fmax(energy, 1e-9);
    const double left = sqrt(fmax(squares - coefficient * (2.0 * cross - coefficient * energy), 0));
    return level > 0.0 ? coefficient * coefficient / ((left + 1.0) * level) : 0.0;
}

static int32_t corrected_bits(const struct rl_seen *seen,
                              const struct rl_transmission *transmission)
{
    const uint32_t packet = transmission->bits;
    double sum[RL_PACKET_BITS] = {0.0}, count[RL_PACKET_BITS] = {0.0};
    double newest = -INFINITY, level[2] = {0.0, 0.0}, bits[2] = {0.0, 0.0};
    for (int row = seen->rows - 1; row >= 0; row--) {
        const double middle_s = (seen->begin_s[row] + seen->end_s[row]) / 2;
        const double since = floor((middle_s - transmission->start_s) / transmission->bit_s);
        if (seen->valid[row] && since > newest - RL_PACKET_BITS) {
            newest = fmax(newest, since);
            const int bit = rl_bit_of((int)since);
            sum[bit] += (double)seen->signal[row];
            count[bit] += 1.0;
        }
    }
    for (int bit = 0; bit < RL_PACKET_BITS; bit++) {
        if (count[bit] > 0.0) {
            const int dark = (packet & rl_packet_bit(bit)) != 0;
            level[dark] += sum[bit] / count[bit];
            bits[dark] += 1.0;
        }
    }
    const double middle = (level[0] / bits[0] + level[1] / bits[1]) / 2;
    int32_t corrected = 0;
    for (int bit = 0; bit < RL_PACKET_BITS && bits[0] * bits[1] > 0.0; bit++) {
        const bool dark = (packet & rl_packet_bit(bit)) != 0;
        corrected += count[bit] > 0.0 && (sum[bit] / count[bit] < middle) != dark;
    }
    return corrected;
}

bool rl_place(struct rl_detector *detector, const struct rl_reading *reading,
              struct rl_placement *placement)
{
    const struct rl_samples *samples = &detector->samples;
    const struct rl_verdict *verdict = &reading->verdict;
    const struct rl_sensor *sensor = &samples->sensor;
    struct rl_amplitude amplitude;
    int first;
    struct rl_seen seen = window_of(detector, verdict, &first);
    for (int zone = 0; zone < samples->zones; zone++) {
        look_at(detector, verdict, &seen, first, zone);
        lay_others(detector, verdict, zone, &seen);
        rl_fit_amplitude(samples, &seen, zone, &amplitude);
    }
    choose_zones(samples, reading, &amplitude, placement);
    struct rl_ranged ranged[RL_MAX_READ];
    const int found = range_zones(detector, reading, &seen, first, &amplitude, placement, ranged);
    if (!combine(ranged, found, placement)) {
        return false;
    }
    const int strongest = placement->zone[0];
    placement->amplitude = amplitude.of[strongest];
    placement->noise = amplitude.noise[strongest];
    placement->score = amplitude.score[strongest];
    placement->range_m = fmax(placement->range_m - sensor->range_offset_m, RL_NEAREST_M);
    placement->bearing =
        rl_bearing_of(&detector->bearing, samples->sensor.rows, samples->sensor.columns,
                      strongest, amplitude.of, amplitude.variance, sensor->zone_blur);
    look_at(detector, verdict, &seen, first, strongest);
    placement->likelihood = likelihood_of(&seen, verdict);
    placement->corrected_bits = corrected_bits(&seen, &verdict->transmission);
    int last = first + seen.rows - 1;
    while (last > first && samples->stamp_ns[last] == RL_NO_FRAME) {
        last--;
    }
    placement->end_ns = samples->stamp_ns[last];
    return true;
}
