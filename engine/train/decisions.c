/* SPDX-License-Identifier: Apache-2.0 */
/* Names the parts that a run decides about, and measures what they take in a scene folder; see stages.h. */
#include "train/stages.h"

#include "base/vec3.h"
#include "scene/scene_json.h"

const char *pags_decision_name(pags_train_decision part) {
  static const char *const names[PAGS_DECISIONS] = {"sky", "exposure", "camera_poses", "light"};
  return names[part];
}

void pags_decision_leave_out(pags_train_decision part, const pags_dataset *dataset, int64_t index,
                             pags_scene_view *view) {
  static const double neutral[6] = {1.0, 1.0, 1.0, 0.0, 0.0, 0.0};
  switch (part) {
    case PAGS_DECISION_EXPOSURE:
      pags_copy3(neutral, view->gain);
      pags_copy3(neutral + 3, view->offset);
      break;
    case PAGS_DECISION_POSES:
      memcpy(view->camera.world_from_camera, pags_dataset_view(dataset, index)->camera.world_from_camera,
             sizeof view->camera.world_from_camera);
      memset(view->correction, 0, sizeof view->correction);
      break;
    case PAGS_DECISION_LIGHT: view->photometric = (pags_photometric){.vignette = {0.0}}; break;
    default: break;
  }
}

pags_result pags_decision_bytes(pags_train_decision part, const pags_dataset *dataset, const pags_scene *scene,
                                int64_t *bytes) {
  pags_scene views = {.view_count = scene->view_count, .views = scene->views};
  uint64_t with = 0, without = 0;
  PAGS_TRY(pags_scene_json_size(&views, &with));
  views.views = malloc((size_t)(views.view_count + 1) * sizeof *views.views);
  PAGS_AUTOFREE pags_scene_view *copies = views.views;
  PAGS_CHECK_MEMORY(copies, "%lld views", (long long)views.view_count);
  for (int64_t i = 0; i < views.view_count; i++) {
    copies[i] = scene->views[i];
    pags_decision_leave_out(part, dataset, i, copies + i);
  }
  PAGS_TRY(pags_scene_json_size(&views, &without));
  *bytes = (int64_t)with - (int64_t)without;
  return PAGS_OK;
}
