/* SPDX-License-Identifier: Apache-2.0 */
/* Small photographs and where they were taken (small_photo.h). */
#include "dataset/driving/small_photo.h"

#include "image/pixels.h"
#include "maths/maths.h"

#include <math.h>

pags_result pags_small_photo_load(const pags_dataset *dataset, int64_t view, int width, pags_image *grey,
                                  double *step) {
  pags_image full;
  const int turn = dataset->parsed.views[view].turn;
  *grey = (pags_image){0};
  PAGS_TRY(pags_image_load(dataset->views[view].image_path, PAGS_U8, 1, &full));
  pags_result result = turn > 1 ? pags_image_turn(&full, turn) : PAGS_OK;
  *step = fmax((double)full.width / width, 1);
  if (result == PAGS_OK)
    result = pags_image_create(grey, (int)fmax(full.width / *step, 1), (int)fmax(full.height / *step, 1), 1, PAGS_U8);
  if (result == PAGS_OK)
    result = pags_shrink_mean(&full, *step, *step, grey);
  pags_image_destroy(&full);
  if (result != PAGS_OK)
    pags_image_destroy(grey);
  return result;
}

double pags_view_distance(const pags_dataset *dataset, int64_t a, int64_t b) {
  const double *p = dataset->views[a].camera.world_from_camera, *q = dataset->views[b].camera.world_from_camera;
  return sqrt((p[3] - q[3]) * (p[3] - q[3]) + (p[7] - q[7]) * (p[7] - q[7]) + (p[11] - q[11]) * (p[11] - q[11]));
}

double pags_view_angle(const pags_dataset *dataset, int64_t a, int64_t b) {
  const double *p = dataset->views[a].camera.world_from_camera, *q = dataset->views[b].camera.world_from_camera;
  return 57.29577951308232 * pags_acos(fmax(-1, fmin(1, p[2] * q[2] + p[6] * q[6] + p[10] * q[10])));
}
