/* SPDX-License-Identifier: Apache-2.0 */
/* Cameras of a scene's views as training corrected them and as they were recorded; see pags/scene.h. */
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
