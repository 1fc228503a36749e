/* Copyright 2026 retrolidar_ros contributors
 * SPDX-License-Identifier: Apache-2.0
 */
#include "retrolidar_pose.h"

#include <math.h>
#include <string.h>

/* Yaw and pitch of a marker are not measured, but beyond 60 degrees it cannot be read (paper
 * Fig. 11b); its roll is arbitrary. Variances of the uniform distributions [rad^2].
 */
static const double TILT_VARIANCE = 1.0471975511965976 * 1.0471975511965976 / 3.0;
static const double ROLL_VARIANCE = 3.141592653589793 * 3.141592653589793 / 3.0;

enum { AXES = 3, TANGENTS = 2 };

/* The shortest turn from the optical axis to a direction. */
static void face_sensor(const double direction[AXES], double quaternion[4])
{
    const double length = sqrt(2.0 + 2.0 * direction[2]);
    quaternion[0] = -direction[1] / length;
    quaternion[1] = direction[0] / length;
    quaternion[2] = 0.0;
    quaternion[3] = (1.0 + direction[2]) / length;
}

void rl_pose(const double *tangent, const double *tangent_variance, double range_m,
             double range_variance, struct rl_pose *pose)
{
    const double secant = sqrt(tangent[0] * tangent[0] + tangent[1] * tangent[1] + 1.0);
    const double direction[AXES] = {tangent[0] / secant, tangent[1] / secant, 1.0 / secant};
    double across[AXES][AXES], trace = 0.0, squares = 0.0;
    for (int i = 0; i < AXES; i++) {
        for (int j = 0; j < AXES; j++) {
            across[i][j] = 0.0;
            for (int k = 0; k < TANGENTS; k++) {
                /* Derivatives of the direction with respect to the tangent. */
                const double one = ((i == k) - direction[i] * direction[k]) / secant;
                const double other = ((j == k) - direction[j] * direction[k]) / secant;
                across[i][j] += one * other * tangent_variance[k];
            }
            trace += i == j ? across[i][j] : 0.0;
            squares += across[i][j] * across[i][j];
        }
    }
    /* The marker is on a sphere, which bends away from the tangent plane by half the square of the
     * angle; this is the mean square of that for a normal distribution.
     */
    const double bend = (trace * trace + 2.0 * squares) / 4.0;
    const double along = range_variance + range_m * range_m * bend;
    memset(pose, 0, sizeof *pose);
    for (int i = 0; i < AXES; i++) {
        pose->position[i] = range_m * direction[i];
        for (int j = 0; j < AXES; j++) {
            const double sight = direction[i] * direction[j];
            pose->covariance[i][j] = range_m * range_m * across[i][j] + along * sight;
            pose->covariance[AXES + i][AXES + j] =
                TILT_VARIANCE * ((i == j) - sight) + ROLL_VARIANCE * sight;
        }
    }
    face_sensor(direction, pose->orientation);
}
