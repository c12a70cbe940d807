/* SPDX-License-Identifier: Apache-2.0 */
/* Estimates the distance of the subject that a set of cameras looks at, and draws depths around it for initial
 * points. */
#ifndef PAGS_DATASET_FOCUS_H
#define PAGS_DATASET_FOCUS_H

#include <stdbool.h>

#include <pags/camera.h>

/* Estimates the distance of the subject in metres: the median depth of the point nearest to all optical axes. When
 * the cameras have no common subject (they look ahead in parallel, or outward), the distance is 4 times the root mean
 * square distance of the camera centres from their mean; when that is zero, too (a single camera), the distance
 * is 1. */
pags_result pags_focus_distance(const pags_camera *const *cameras, int64_t count, double *out);

/* Maps `draw`, a uniform random number in [0, 1), to a depth: log-uniform between 0.45 and 4 times the distance of
 * the subject. */
double pags_focus_depth(double distance, double draw);

/* Whether `point` projects into the picture of the camera and its depth is at least `nearest` (metres). */
bool pags_camera_sees(const pags_camera *camera, const double point[3], double nearest);

#endif
