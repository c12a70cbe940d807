/* SPDX-License-Identifier: Apache-2.0 */
/* Extracts the Gaussians of one object in its own frame. The composition places the object at the identity
 * pose, so that the Gaussians it would draw in the world are in the object's frame. Also makes objects' tracks. */
#include "exporters/format/object_gaussians.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "exporters/format/bake.h"
#include "exporters/proxy/object_proxy.h"

double pags_scene_time_zero(const pags_scene *scene) {
  double zero = scene->time_begin;
  for (int64_t i = 0; i < scene->object_count; i++)
    zero = fmin(zero, scene->objects[i].record.keyframes[0].time);
  return zero;
}

/* ---- Gaussians ---- */

pags_result pags_object_gaussians(pags_composition *composition, int64_t object, double time, int sh_degree,
                                  pags_gaussians *out) {
  const pags_scene *scene = pags_composition_scene(composition);
  pags_placement placement = {.object = object, .world_from_object = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const pags_part *parts;
  int count;
  if (object >= 0 && !pags_composition_is_tracked(composition, object)) {
    /* The composition moves a parked object's Gaussians by (placement x inverse of the rest pose). For Gaussians
     * relative to the parked pose the placement must be (inverse of the parked pose x rest pose). */
    const pags_object *record = &scene->objects[object].record;
    double parked[12], back[12], rest[12];
    pags_object_label_pose(scene, record, record->keyframe_count / 2, parked);
    pags_rigid_inverse(parked, back);
    pags_composition_rest_pose(composition, object, rest);
    pags_pose_subtract(rest, scene->origin);
    pags_rigid_multiply(back, rest, placement.world_from_object);
  }
  for (int k = 0; k < 3 && object >= 0; k++)
    placement.world_from_object[4 * k + 3] += scene->origin[k];
  *out = (pags_gaussians){0};
  PAGS_TRY(pags_compose_placed(composition, time, &placement, 1, &parts, &count));
  return pags_splats_bake(parts, count, sh_degree, false, out);
}

pags_result pags_object_gaussians_degree(pags_composition *composition, int most, int *out) {
  const pags_scene *scene = pags_composition_scene(composition);
  int degree = 0;
  *out = 0;
  for (int64_t object = -1; object < scene->object_count && degree < most; object++) {
    const pags_placement placement = {.object = object, .world_from_object = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    const pags_part *parts;
    int count;
    PAGS_TRY(pags_compose_placed(composition, (double)NAN, &placement, 1, &parts, &count));
    for (int i = 0; i < count; i++)
      degree = parts[i].gaussians->sh_degree > degree ? parts[i].gaussians->sh_degree : degree;
  }
  *out = degree < most ? degree : most;
  return PAGS_OK;
}

/* ---- Tracks ---- */

pags_result pags_object_track_make(const pags_scene *scene, const pags_object *object, double time_zero,
                                   pags_object_track *out) {
  const int64_t count = object->moving ? object->keyframe_count : 1;
  *out = (pags_object_track){.count = count,
                             .times = malloc((size_t)count * sizeof *out->times),
                             .poses = malloc((size_t)count * sizeof *out->poses)};
  PAGS_CHECK_MEMORY(out->times && out->poses, "a track");
  for (int64_t i = 0; i < count; i++) {
    out->times[i] = object->keyframes[i].time - time_zero;
    pags_object_label_pose(scene, object, object->moving ? i : object->keyframe_count / 2, out->poses[i]);
  }
  return PAGS_OK;
}

void pags_object_track_destroy(pags_object_track *track) {
  free(track->times);
  free(track->poses);
  *track = (pags_object_track){0};
}
