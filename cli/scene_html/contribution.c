/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/scene_html/pack.h"

#include <math.h>
#include "cli/draw/picture.h"
#include "frame/owners.h"

enum { MOST_CAMERAS = 48, MOST_SIDE = 640 };

static void add_weight(void *user, int64_t id, double weight) {
  float *const sums = user;
  sums[id] += (float)weight;
}

pags_result pags_contribution_measure(pags_composition *composition, const pags_camera_path *path, pags_tasks *tasks,
                                      pags_progress_fn *progress, void *user, float *weight) {
  const pags_frame_options options = pags_composition_options(composition);
  PAGS_AUTO(pags_frame_destroy_auto) pags_frame *frame = NULL;
  PAGS_TRY(pags_frame_create(tasks, &frame));
  memset(weight, 0, (size_t)pags_composition_gaussian_count(composition) * sizeof *weight);
  const int64_t count = path->count < MOST_CAMERAS ? path->count : MOST_CAMERAS;
  for (int64_t i = 0; i < count; i++) {
    pags_camera camera = path->cameras[i * path->count / count];
    const double by = fmin(1, (double)MOST_SIDE / (camera.width > camera.height ? camera.width : camera.height));
    camera.width = (int)fmax(1, floor(camera.width * by));
    camera.height = (int)fmax(1, floor(camera.height * by));
    camera.fx *= by;
    camera.fy *= by;
    camera.cx *= by;
    camera.cy *= by;
    PAGS_TRY(pags_picture_weights(composition, frame, &camera, &options, add_weight, weight));
    if (progress && !progress(user, (double)(i + 1) / (double)count, "contributions"))
      return pags_fail(PAGS_CANCELLED, "interrupted");
  }
  return PAGS_OK;
}
