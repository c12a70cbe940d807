/* SPDX-License-Identifier: Apache-2.0 */
/* Splits a scene for export: the Gaussians of each object in the object's own frame, those of the background in
 * the world's frame, and each object's track. */
#ifndef PAGS_FORMAT_OBJECT_GAUSSIANS_H
#define PAGS_FORMAT_OBJECT_GAUSSIANS_H

#include <pags/compose.h>
#include <pags/gaussians.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The Gaussians of one object in the frame of its labelled box, spherical harmonics rotated with them. `object` -1:
 * the Gaussians that belong to no object, relative to the scene's origin. Time-dependent colours are taken at `time`
 * (seconds; NaN: the scene's begin). The result is empty if the object has no Gaussians. */
pags_result pags_object_gaussians(pags_composition *composition, int64_t object, double time, int sh_degree,
                                  pags_gaussians *out);

/* The highest degree of spherical harmonics of any Gaussians of the scene, but no more than `most`. */
pags_result pags_object_gaussians_degree(pags_composition *composition, int most, int *out);

/* The track of an object: its poses (rigid, 3x4, relative to the scene's origin) at its labelled times (seconds after
 * `time_zero`). A parked object has one pose, that of the middle one of its labels. */
typedef struct pags_object_gaussians_track {
  int64_t count;
  double *times;
  double (*poses)[12];
} pags_object_gaussians_track;
pags_result pags_object_gaussians_track_make(const pags_composition *composition, int64_t object, double time_zero,
                                             pags_object_gaussians_track *out);
void pags_object_gaussians_track_destroy(pags_object_gaussians_track *track);

#ifdef __cplusplus
}
#endif
#endif
