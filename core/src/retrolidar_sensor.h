/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* All that the core knows of a sensor. To use another one, fill this struct: `SensorModel` in
 * Python has the values of a VL53L8CX and where they come from.
 */
#ifndef RETROLIDAR_SENSOR_H
#define RETROLIDAR_SENSOR_H

#include <stdint.h>

/* binding */
enum {
    RL_MAX_ZONES = 64,
    RL_MAX_LATE_NS = 150000000, /* a frame that is out of order is late by no more */
};

/* What the status of a sample says. */
enum {
    RL_INVALID,    /* nothing: an erasure */
    RL_VALID,      /* signal and distance are valid */
    RL_NO_TARGET,  /* no target: a marker may be dark */
    RL_LOW_SIGNAL, /* signal too low: as no target if it is below `low_signal` */
};

struct rl_sensor {
    int32_t rows, columns; /* of zones, RL_MAX_ZONES at the most */
    double zone_pitch;     /* width of a zone as a tangent */
    double zone_blur; /* of the optics, standard deviation [widths of a zone]; 0 if not known */
    double z_per_range[RL_MAX_ZONES]; /* distance that is reported over radial range */
    double range_offset_m;            /* all ranges are measured too long by this */
    double exposure;                  /* share of the frame period, about the stamp */
    /* Variance of the signal S in ambient light A: floor + slope S + ambient A [(kcps/SPAD)^2]. */
    double noise_floor, noise_slope, noise_ambient;
    /* Deviation of a distance at a signal S: hypot(shot / S, floor) [m]. */
    double ranging_shot, ranging_floor_m;
    double signal_step, low_signal, max_signal; /* [kcps/SPAD] */
    double distance_step_m, max_distance_m;
    double separable_m;   /* least distance between two targets that a zone separates */
    uint8_t meaning[256]; /* of each status */
};
/* end of binding */

#endif
