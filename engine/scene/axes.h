/* SPDX-License-Identifier: Apache-2.0 */
/* The directions of a file's axes, and which of them is up. */
#ifndef PAGS_SCENE_AXES_H
#define PAGS_SCENE_AXES_H

#include <stdbool.h>

#include <pags/scene.h>

/* The name of an up axis in files: "unknown", "z", "-y" or "y"; static. */
const char *pags_up_code(pags_up up);
/* The up axis of that name, in any case, with or without '+'. Returns false, with `up` unchanged, for other names. */
bool pags_up_from_code(const char *name, pags_up *up);

/* Turns Gaussians in place from `axes` (a pags_axes) to PLY's (x right, y down, z forward), harmonics included. Axes
 * of the other handedness are mirrored. */
void pags_gaussians_turn(pags_gaussians *g, int axes);

/* Turns a point in the same way. */
void pags_axes_turn_point(int axes, double point[3]);

/* Writes the signs that take a vector from `axes`, one of the first eight, to PLY's axes or back, and those of the SH
 * functions 1 to 15. */
void pags_axes_signs(int axes, int vector[3], int harmonics[15]);

#endif
