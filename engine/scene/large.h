/* SPDX-License-Identifier: Apache-2.0 */
/* Positions that are too large for floats: of a place in a map grid, or on the earth. */
#ifndef PAGS_SCENE_LARGE_H
#define PAGS_SCENE_LARGE_H

#include <pags/gaussians.h>

/* From 4096 m on, neighbouring floats are half a millimetre apart (2^-11 m) or more: positions beyond it are taken
 * relative to an origin of whole metres. */
#define PAGS_LARGE_COORDINATE 4096.0

/* The origin along one axis of which `values` are positions, in metres: their median, which a few stray ones don't
 * move, rounded to whole metres; 0 where that isn't large. Values that aren't finite don't count. Sorts them. */
double pags_large_origin(double *values, int count);

/* Adds `origin` to all means again, which costs their digits. */
void pags_large_put_back(pags_gaussians *g, const double origin[3]);

#endif
