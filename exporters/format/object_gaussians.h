/* SPDX-License-Identifier: Apache-2.0 */
/* Splits a scene for export: the Gaussians of each object in the object's own frame, those of the background in
 * the world's frame, each object's track, and when it is there: objects come late, leave or are lost for a while. */
#ifndef PAGS_FORMAT_OBJECT_GAUSSIANS_H
#define PAGS_FORMAT_OBJECT_GAUSSIANS_H

#include <stdbool.h>

#include <pags/compose.h>
#include <pags/gaussians.h>

/* The Gaussians of one object in the frame of its labelled box, spherical harmonics rotated with them. `object` -1:
 * the Gaussians that belong to no object, relative to the scene's origin. Time-dependent colours are taken at `time`
 * (seconds; NaN: the scene's begin). The result is empty if the object has no Gaussians. After a failure, too, the
 * caller destroys `out`. */
pags_result pags_object_gaussians(pags_composition *composition, int64_t object, double time, int sh_degree,
                                  pags_gaussians *out);

/* The highest degree of spherical harmonics of any Gaussians of the scene, but no more than `most`. */
pags_result pags_object_gaussians_degree(pags_composition *composition, int most, int *out);

/* The time of the scene that is 0 in files, in seconds: its begin or the first label of an object, if that is
 * earlier. */
double pags_scene_time_zero(const pags_scene *scene);

/* The track of an object: its poses (rigid, 3x4, relative to the scene's origin) at its labelled times (seconds after
 * `time_zero`). A parked object has one pose, that of the middle one of its labels. */
typedef struct pags_object_track {
  int64_t count;
  double *times;
  double (*poses)[12];
} pags_object_track;
/* After a failure, too, the caller destroys `out`. PAGS_ERROR_MEMORY. */
pags_result pags_object_track_make(const pags_scene *scene, const pags_object *object, double time_zero,
                                   pags_object_track *out);
void pags_object_track_destroy(pags_object_track *track);

typedef struct pags_presence {
  bool always;        /* it is there all the time that the scene lasts */
  int64_t count;      /* else how often it comes */
  double (*spans)[2]; /* seconds of the scene's clock: when it comes, when it is gone */
} pags_presence;

/* Finds when object `object` has a pose (pags_object_pose). Objects parked in the background are always there. After a
 * failure, too, the caller destroys `out`. PAGS_ERROR_MEMORY. */
pags_result pags_presence_find(const pags_scene *scene, int64_t object, pags_presence *out);
void pags_presence_destroy(pags_presence *presence);

/* Logs how many objects aren't there all the time, which glTF can't show, and names the first. PAGS_ERROR_MEMORY. */
pags_result pags_presence_tell(const pags_scene *scene);

#endif
