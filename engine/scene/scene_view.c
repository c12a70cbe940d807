/* SPDX-License-Identifier: Apache-2.0 */
/* The views of a scene: their cameras as training corrected them and as they were recorded, and the exposure of a
 * camera of the rig at any time, interpolated linearly between those that training found for its views. */
#include <math.h>

#include <pags/object.h>
#include <pags/scene.h>

int pags_scene_view_is_corrected(const pags_scene_view *view) {
  int corrected = 0;
  for (int k = 0; k < 6; k++)
    corrected |= view->correction[k] != 0;
  return corrected;
}

pags_camera pags_scene_view_recorded(const pags_scene_view *view) {
  pags_camera camera = view->camera;
  double motion[12];
  if (!pags_scene_view_is_corrected(view))
    return camera;
  pags_increment_matrix(view->correction, view->correction + 3, motion);
  pags_rigid_inverse(motion, motion);
  pags_rigid_multiply(camera.world_from_camera, motion, camera.world_from_camera);
  return camera;
}

/* Returns the training view of camera `sensor` that is nearest to `time` (seconds) among those at or before `time`
 * (sign -1) or at or after it (sign +1); NULL if not found. */
static const pags_scene_view *neighbour(const pags_scene *scene, int sensor, double time, int sign) {
  const pags_scene_view *best = NULL;
  double least = INFINITY;
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_scene_view *v = &scene->views[i];
    double apart = (v->camera.time - time) * sign;
    if (v->test || v->sensor != sensor || !(apart >= 0.0 && apart < least))
      continue;
    least = apart;
    best = v;
  }
  return best;
}

void pags_scene_exposure(const pags_scene *scene, int sensor, double time, double gain[3], double offset[3]) {
  const pags_scene_view *before = neighbour(scene, sensor, time, -1), *after = neighbour(scene, sensor, time, 1);
  static const pags_scene_view plain = {.gain = {1, 1, 1}};
  const pags_scene_view *a = before ? before : after ? after : &plain, *b = after ? after : a;
  const double span = b->camera.time - a->camera.time, u = span > 0.0 ? (time - a->camera.time) / span : 0.0;
  for (int c = 0; c < 3; c++) {
    gain[c] = a->gain[c] + u * (b->gain[c] - a->gain[c]);
    offset[c] = a->offset[c] + u * (b->offset[c] - a->offset[c]);
  }
}
