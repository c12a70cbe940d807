/* SPDX-License-Identifier: Apache-2.0 */
/* A small driving data set with known values, which tests write as a Waymo segment and import. */
#ifndef PAGS_TESTS_UNIT_WAYMO_SET_H
#define PAGS_TESTS_UNIT_WAYMO_SET_H

enum { FRAMES = 4, CAMERAS = 3, WIDTH = 96, HEIGHT = 64, POINTS = 400, TRACKS = 4 };

/* The ego vehicle's pose in the world: tens of kilometres from the origin, pitched and rolled, driving. Row-major
 * 3x4, like all poses here. */
void waymo_set_ego(int t, double out[12]);
/* A camera's pose on the ego vehicle. */
void waymo_set_camera(int c, double out[12]);

/* Writes the data set to `folder`; the lens of camera 2 has distortion. An error fails the test. */
void waymo_set_make(const char *folder);

#endif
