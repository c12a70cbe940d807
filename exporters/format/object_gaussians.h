/* SPDX-License-Identifier: Apache-2.0 */
/* A scene's Gaussians apart by whose they are, each object's in its own frame. */
#ifndef PAGS_FORMAT_OBJECT_GAUSSIANS_H
#define PAGS_FORMAT_OBJECT_GAUSSIANS_H

#include <pags/compose.h>
#include <pags/gaussians.h>

#ifdef __cplusplus
extern "C" {
#endif

/* `object`'s, in its box's frame, harmonics turned with them; -1: nobody's, relative to the scene's origin. Colours
 * that change are as they are at `time` (NaN: the scene's begin). Empty where it has none. */
pags_result pags_object_gaussians(pags_composition *composition, int64_t object, double time, int sh_degree,
                                  pags_gaussians *out);

/* The highest degree of any of the scene's Gaussians at most `most`. */
pags_result pags_object_gaussians_degree(pags_composition *composition, int most, int *out);

/* An object's poses relative to the origin at its labelled times, in seconds after `time_zero`; parked ones have one,
 * of their middle label. */
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
