/* SPDX-License-Identifier: Apache-2.0 */
/* What a set of cameras looks at. */
#ifndef PAGS_DATASET_FOCUS_H
#define PAGS_DATASET_FOCUS_H

#include <stdbool.h>

#include <pags/camera.h>

/* The distance at which things are, metres: the median depth of the point nearest to all optical axes. Cameras that
 * have no subject in common (they look ahead, or outward) say nothing but how far they are apart, and it is 4 times
 * that; one camera alone says nothing at all, and it is 1. */
pags_result pags_focus_distance(const pags_camera *const *cameras, int64_t count, double *out);

/* A depth by chance, `draw` in [0, 1): evenly spread in its logarithm over 0.45 to 4 times the subject's distance. */
double pags_focus_depth(double distance, double draw);

/* The point lies within the picture and at least `nearest` in front of the camera. */
bool pags_camera_sees(const pags_camera *camera, const double point[3], double nearest);

#endif
