/* SPDX-License-Identifier: Apache-2.0 */
/* A small driving data set of which everything is known, to be written as a Waymo segment and read back. */
#ifndef PAGS_TESTS_UNIT_WAYMO_SET_H
#define PAGS_TESTS_UNIT_WAYMO_SET_H

enum { FRAMES = 4, CAMERAS = 3, WIDTH = 96, HEIGHT = 64, POINTS = 400, TRACKS = 4 };

/* The car's pose in the world: tens of kilometres off, pitched and rolled, driving. Row-major 3x4, as all here. */
void waymo_set_ego(int t, double out[12]);
/* A camera's on the car. */
void waymo_set_camera(int c, double out[12]);

/* Writes the data set to `folder`; camera 2's lens distorts. Fails the test where that fails. */
void waymo_set_make(const char *folder);

#endif
