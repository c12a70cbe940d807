/* SPDX-License-Identifier: Apache-2.0 */
/* The radial functions of lenses (pags/lens.h), for the undistortion of photographs. */
#ifndef PAGS_SCENE_LENS_H
#define PAGS_SCENE_LENS_H

#include <stdbool.h>

#include <pags/lens.h>

/* Whether the radial function takes the angle from the axis, radians; otherwise it takes the distance from the axis on
 * the plane z = 1. */
bool pags_lens_is_of_angle(pags_lens_kind kind);

/* The distance from the principal point at which the lens shows this angle or distance, in focal lengths, without
 * tangential and prism terms. */
double pags_lens_radius(const pags_lens_model *lens, double s);

/* The smallest t = s^2 in (0, end) at which the radial function stops growing, or `end` if it grows throughout. */
double pags_lens_grows_until(const pags_lens_model *lens, double end);

#endif
