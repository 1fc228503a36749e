/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* When and where the marker of a reading is, from what all zones saw of it. */
#include "retrolidar_detector_state.h"

#include <math.h>

/* Any packet explains this share of another one's light, as all begin with the preamble. */
static const double ALIKE = (double)RL_PREAMBLE_BITS / RL_PACKET_BITS;

/* Fit of the light to the signal of each zone: gain, its variance, and the residual variance. */
struct amplitude {
    double of[RL_MAX_ZONES], variance[RL_MAX_ZONES], noise[RL_MAX_ZONES];
    double unknown[RL_MAX_ZONES]; /* light that is not known, in the unit of the gain */
    double score[RL_MAX_ZONES]; /* correlation of the signal with the light */
};

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
        .alone = detector->window.part,
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

/* Slope of the signal over light whose mean is 0. */
static double rise_with(const struct rl_seen *seen, const double *light)
{
    double cross = 0.0, energy = 1e-9;
    for (int row = 0; row < seen->rows; row++) {
        cross += light[row] * (double)seen->signal[row];
        energy += light[row] * light[row];
    }
    return cross / energy;
}

static void fit_amplitude(const struct rl_samples *samples, const struct rl_seen *seen, int zone,
                          struct amplitude *amplitude)
{
    double of_other[RL_MAX_OTHERS], count = 0.0, signal = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        count += seen->valid[row];
        signal += seen->valid[row] ? (double)seen->signal[row] : 0.0;
    }
    signal /= fmax(count, 1.0);
    /* A hand that passes gives a zone without a target a few samples, which any gain fits. Fewer
     * than the bits in which words differ tell none.
     */
    const bool is_known = count >= RL_WORD_DISTANCE;
    const double energy = fmax(is_known ? rl_orthogonalise(seen, seen->valid) : 0.0, 1e-9);
    const double rise = is_known ? rise_with(seen, seen->alone) : 0.0;
    for (int i = 0; i < seen->others; i++) {
        of_other[i] = is_known ? rise_with(seen, seen->other + i * seen->rows) : 0.0;
    }
    double power = 0.0, alike = 0.0, before = 0.0;
    for (int row = 0; row < seen->rows; row++) {
        double left = (double)seen->signal[row] - signal - rise * seen->alone[row];
        for (int i = 0; i < seen->others; i++) {
            left -= of_other[i] * seen->other[i * seen->rows + row];
        }
        left = seen->valid[row] ? left : 0.0;
        power += left * left;
        alike += left * before;
        before = left;
    }
    /* The residual may be another marker, whose samples are correlated. The noise is at least that
     * of the sensor's quantisation.
     */
    const double step = seen->sensor->signal_step;
    const double noise = fmax(power / fmax(count - 2.0, 1.0), step * step / 12.0);
    amplitude->of[zone] = rise;
    amplitude->noise[zone] = noise;
    const double excess = fmax(noise - rl_noise_variance(samples, zone, signal), 0.0);
    amplitude->unknown[zone] = sqrt(excess * count / energy);
    amplitude->score[zone] = fmax(rise, 0.0) / sqrt(rise * rise + power / energy + 1e-30);
    amplitude->variance[zone] = noise * (1.0 + 2.0 * fmax(alike / fmax(power, 1e-9), 0.0)) / energy;
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

/* List the zones that surely saw the packet, sorted by their gain: it is more than three deviations
 * and what may be of another marker that is not known yet. Return whether there is any.
 */
static bool choose_zones(const struct rl_samples *samples, const struct rl_reading *reading,
                         const struct amplitude *amplitude, struct rl_placement *placement)
{
    double certain[RL_MAX_ZONES], most = 0.0;
    for (int zone = 0; zone < samples->zones; zone++) {
        const double doubt = RL_MIN_SEEN * sqrt(amplitude->variance[zone]) +
                             ALIKE * amplitude->unknown[zone];
        certain[zone] = is_near(samples, reading, zone) ? amplitude->of[zone] - doubt : 0.0;
        most = fmax(most, certain[zone]);
    }
    placement->zones = 0;
    for (int zone = 0; zone < samples->zones; zone++) {
        const bool has_part = certain[zone] > 0.0 && amplitude->of[zone] >= RL_MIN_PART * most;
        if (has_part || zone == reading->zone[0]) {
            rl_add_zone(placement->zone, &placement->zones, RL_MAX_READ, zone,
                        amplitude->of);
        }
    }
    return most > 0.0;
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

/* The mean of the ranges of the zones, weighted by one over the variance. */
static bool find_range(struct rl_detector *detector, const struct rl_reading *reading,
                       struct rl_seen *seen, int first, bool is_certain,
                       struct rl_placement *placement)
{
    const double *z_per_range = seen->sensor->z_per_range;
    double precision = 0.0, range_m = 0.0, squares = 0.0, time_s = 0.0, common = 0.0;
    int found = 0;
    for (int i = 0; i < placement->zones; i++) {
        const int zone = placement->zone[i];
        struct rl_ranged ranged;
        look_at(detector, &reading->verdict, seen, first, zone);
        /* A distance is of all the light that comes back. */
        seen->signal = detector->samples.signal + rl_sample(&detector->samples, zone, first);
        lay_others(detector, &reading->verdict, zone, seen);
        if (rl_ranging(seen, detector->values, detector->role, &ranged)) {
            /* The sensor projects by the factor of the zone, not of the target. */
            ranged.variance += is_certain ? 0.0 : spread_of(seen);
            const double square = z_per_range[zone] * z_per_range[zone];
            const double weight = square / ranged.variance;
            precision += weight;
            common += weight * sqrt(ranged.common / square);
            const double zone_m = ranged.depth_m / z_per_range[zone];
            range_m += weight * zone_m;
            squares += weight * zone_m * zone_m;
            found++;
            time_s += weight * ranged.time_s;
        }
    }
    if (!(precision > 0.0)) {
        return false;
    }
    placement->range_m = range_m / precision;
    common /= precision;
    /* If zones differ by more than their variances, that is the variance (Birge 1932). */
    const double spread = (squares - range_m * range_m / precision) / fmax(found - 1, 1);
    placement->range_variance = fmax(spread, 1.0) / precision + common * common;
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
    struct amplitude amplitude;
    int first;
    struct rl_seen seen = window_of(detector, verdict, &first);
    for (int zone = 0; zone < samples->zones; zone++) {
        look_at(detector, verdict, &seen, first, zone);
        lay_others(detector, verdict, zone, &seen);
        fit_amplitude(samples, &seen, zone, &amplitude);
    }
    const bool is_certain = choose_zones(samples, reading, &amplitude, placement);
    if (!find_range(detector, reading, &seen, first, is_certain, placement)) {
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
