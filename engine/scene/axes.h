/* SPDX-License-Identifier: Apache-2.0 */
/* The directions of a file's axes, and which of them is up; the rotation of spherical harmonics of degrees 1, 2 and 3
 * that goes with a rotation of directions. */
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

/* The rotation R of directions is row-major 3x3: the rotated function has in direction R d the value that the function
 * had in direction d. */
typedef struct pags_sh_rotation {
  double m[3][7][7]; /* of degree l: m[l - 1], its first 2 l + 1 rows and columns */
} pags_sh_rotation;
void pags_sh_rotation_make(const double rotation[9], pags_sh_rotation *out);
/* Rotates the coefficients of one colour channel in place. `rest` begins with term 1: the constant term 0 is the same
 * in all directions and isn't in it. */
void pags_sh_rotation_apply(const pags_sh_rotation *turn, int degree, double *rest);
/* The same for all channels of a row. */
void pags_sh_rotation_apply_row(const pags_sh_rotation *turn, int degree, pags_gaussians *g, int64_t row);

#endif
