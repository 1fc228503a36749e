/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* What becomes known with a packet that is read. */
#include "retrolidar_detector_state.h"

#include <math.h>
#include <string.h>

/* Energy of a packet in a zone, beside what else is known to be there; 0 without evidence. */
static double energy_in(struct rl_window *window, int zone, const struct rl_verdict *verdict)
{
    window->reference = RL_NO_REFERENCE;
    rl_window_open(window, zone, false, verdict->begin_s, verdict->end_s);
    const double price = rl_window_follow_gain(window, &verdict->transmission);
    const double likelihood = rl_window_try(window, &verdict->transmission);
    double mean = window->has_profile ? 0.0 : 1.0;
    for (int row = 0; window->has_profile && row < window->rows; row++) {
        mean += window->profile[row] / window->rows;
    }
    const double gain = window->fit.gain * mean;
    return likelihood - price > window->whitened.null + RL_COST_OF_CHANCE ? gain * gain : 0.0;
}

/* The zones that saw a packet, of a sum those with a part in it, the strongest first. */
static int zones_of(struct rl_window *window, const struct rl_verdict *verdict, int32_t *zones)
{
    const struct rl_channel *sum = &window->samples->channel[verdict->channel];
    double most = 0.0, energy[RL_MAX_ZONES];
    int32_t seen = 0;
    zones[0] = sum->zone[0];
    if (sum->zones == 1) {
        return 1;
    }
    for (int i = 0; i < sum->zones; i++) {
        energy[sum->zone[i]] = energy_in(window, sum->zone[i], verdict);
        most = fmax(most, energy[sum->zone[i]]);
    }
    for (int i = 0; i < sum->zones; i++) {
        if (energy[sum->zone[i]] >= RL_MIN_PART * most) {
            rl_add_zone(zones, &seen, RL_MAX_READ, sum->zone[i], energy);
        }
    }
    return seen;
}

/* When the packet begins that the window holds the most of: before the window, if it was joined in
 * its middle, or a few bits later, if those are of another.
 */
static double start_of(const struct rl_verdict *verdict)
{
    const struct rl_transmission *transmission = &verdict->transmission;
    const double packet_s = RL_PACKET_BITS * transmission->bit_s;
    const double packets = (verdict->begin_s - transmission->start_s) / packet_s;
    return transmission->repeats ? transmission->start_s + packet_s * floor(packets + 0.25)
                                 : transmission->start_s;
}

void rl_add_reading(struct rl_detector *detector, const struct rl_verdict *verdict)
{
    const struct rl_samples *samples = &detector->samples;
    detector->counts.accepted++;
    if (detector->readings == RL_READINGS) {
        return;
    }
    int32_t zones[RL_MAX_READ];
    const int seen = zones_of(&detector->window, verdict, zones);
    /* A packet of many frames may have begun before what is held. */
    const double held_s = samples->begin_s[rl_samples_oldest(samples)];
    const struct rl_packet_train train = {verdict->transmission, fmax(verdict->begin_s, held_s),
                                          verdict->end_s};
    struct rl_reading *reading = &detector->reading[detector->readings++];
    *reading = (struct rl_reading){
        .id = verdict->id,
        .repeats = verdict->transmission.repeats,
        .is_dimmer = verdict->is_dimmer,
        .packets = verdict->packets,
        .start_s = start_of(verdict),
        .bit_s = verdict->transmission.bit_s,
        .begin_s = train.begin_s,
        .end_s = train.end_s,
        .evidence = verdict->evidence,
        .margin = verdict->margin,
        .zones = seen,
    };
    memcpy(reading->zone, zones, (size_t)reading->zones * sizeof *zones);
    const struct rl_active_track *track =
        rl_pool_add(&detector->pool, samples, verdict->id, &train, zones, reading->zones);
    /* Its light hid packets in the zones beside, too. */
    detector->read_anew |= track->near;
    for (int channel = 0; channel < samples->channels; channel++) {
        if ((rl_channel_zones(samples, channel) & track->zones) != 0) {
            detector->consumed_until_s[channel] =
                fmax(detector->consumed_until_s[channel], reading->end_s);
        }
    }
}
