/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
/* Pose of a marker from its bearing and its range, with the covariance of what is not measured. */
#ifndef RETROLIDAR_POSE_H
#define RETROLIDAR_POSE_H

/* binding */
/* In the optical frame: x right, y down, z forward. */
struct rl_pose {
    double position[3];      /* [m] */
    double orientation[4];   /* quaternion x, y, z, w: facing the sensor, z pointing away from it */
    double covariance[6][6]; /* of position [m^2] and turns about x, y, z [rad^2] */
};

/* tangent, tangent_variance: x/z and y/z of the marker's direction */
void rl_pose(const double *tangent, const double *tangent_variance, double range_m,
             double range_variance, struct rl_pose *pose);
/* end of binding */

#endif
