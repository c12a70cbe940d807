/* SPDX-License-Identifier: Apache-2.0 */
/* Looks at the photographs of an opened driving set (looks.h). */
#include "dataset/driving/check/looks.h"

#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "dataset/driving/driving_set.h"
#include "image/pixels.h"
#include "maths/maths.h"

#include <math.h>

/* ---- Small photographs ---- */

pags_result pags_small_photo_load(const pags_dataset *dataset, int64_t view, int width, pags_image *grey,
                                  double *step) {
  PAGS_AUTO(pags_image_destroy) pags_image full = {0};
  const int turn = dataset->parsed.views[view].turn;
  *grey = (pags_image){0};
  PAGS_TRY(pags_image_load(dataset->views[view].image_path, PAGS_U8, 1, &full));
  if (turn > 1)
    PAGS_TRY(pags_image_turn(&full, turn));
  *step = fmax((double)full.width / width, 1);
  PAGS_TRY(pags_image_create(grey, (int)fmax(full.width / *step, 1), (int)fmax(full.height / *step, 1), 1, PAGS_U8));
  return pags_shrink_mean(&full, *step, *step, grey);
}

double pags_view_distance(const pags_dataset *dataset, int64_t a, int64_t b) {
  return pags_pose_distance(dataset->views[a].camera.world_from_camera, dataset->views[b].camera.world_from_camera);
}

double pags_view_angle(const pags_dataset *dataset, int64_t a, int64_t b) {
  const double *p = dataset->views[a].camera.world_from_camera, *q = dataset->views[b].camera.world_from_camera;
  return 57.29577951308232 * pags_acos(fmax(-1, fmin(1, p[2] * q[2] + p[6] * q[6] + p[10] * q[10])));
}

/* ---- Held-out photographs ---- */

/* A camera of a lower rate may have its photographs just at the time steps that are held out. */
void pags_held_out_check(const pags_dataset *dataset) {
  const pags_driving *driving = dataset->parsed.driving;
  pags_tally found = {0};
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const int number = driving->sensors[i].number;
    long long all = 0, held = 0;
    for (int64_t v = 0; v < dataset->count; v++) {
      all += dataset->views[v].sensor == number;
      held += dataset->views[v].sensor == number && dataset->views[v].test;
    }
    if (2 * held > all && number != driving->holdout)
      pags_tally_add(&found, "camera %d, %lld of whose %lld photographs are", number, held, all);
  }
  if (found.count)
    PAGS_WARN(
        "%s/images: more than half of the photographs of %lld of %lld cameras are held out, the first is %s; another "
        "--split-every holds out others, 0 none",
        driving->root, (long long)found.count, (long long)driving->sensor_count, found.first);
}
