/* SPDX-License-Identifier: Apache-2.0 */
#include "cli/scene_html/pack.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

enum { MOST_CAMERAS = 48, MOST_SIDE = 640 };

typedef struct contribution {
  const pags_part *parts;
  float *weight;
} contribution;

/* Receives the scores of one cluster; no two clusters share a Gaussian. */
static void add_scores(void *user, const pags_cluster_score *score, int worker) {
  contribution *c = user;
  const pags_part *part = &c->parts[score->part];
  (void)worker;
  for (int k = 0; k < score->count; k++) {
    const int64_t row = score->first + k;
    c->weight[part->id ? part->id[row] : part->first_id + row] += (float)score->seen[k];
  }
}

static pags_camera smaller(pags_camera camera) {
  const double by = fmin(1, (double)MOST_SIDE / (camera.width > camera.height ? camera.width : camera.height));
  camera.width = (int)fmax(1, floor(camera.width * by));
  camera.height = (int)fmax(1, floor(camera.height * by));
  camera.fx *= by;
  camera.fy *= by;
  camera.cx *= by;
  camera.cy *= by;
  return camera;
}

pags_result pags_contribution_measure(pags_composition *composition, const pags_camera_path *path, pags_tasks *tasks,
                                      pags_progress_fn *progress, void *user, float *weight) {
  contribution c = {.weight = weight};
  pags_frame_options options = pags_composition_options(composition);
  pags_frame *frame = NULL;
  float *ones = malloc((size_t)(MOST_SIDE + 64) * (MOST_SIDE + 64) * sizeof *ones);
  float *zeros = calloc((size_t)(MOST_SIDE + 64) * (MOST_SIDE + 64), sizeof *zeros);
  pags_result result = ones && zeros ? pags_frame_create(tasks, &frame) : pags_out_of_memory("contributions");
  if (ones)
    for (int i = 0; i < (MOST_SIDE + 64) * (MOST_SIDE + 64); i++)
      ones[i] = 1;
  memset(weight, 0, (size_t)pags_composition_gaussian_count(composition) * sizeof *weight);
  options.keep_for_backward = 1;
  const int64_t count = path->count < MOST_CAMERAS ? path->count : MOST_CAMERAS;
  for (int64_t i = 0; i < count && result == PAGS_OK; i++) {
    const pags_camera camera = smaller(path->cameras[i * path->count / count]);
    const pags_score_planes planes = {.counted = ones, .critical = zeros};
    pags_picture picture;
    int parts;
    pags_compose(composition, camera.time, &c.parts, &parts);
    result = pags_frame_render(frame, c.parts, parts, &camera, &options, NULL, NULL, &picture);
    if (result == PAGS_OK)
      result = pags_frame_scores(frame, &planes, add_scores, &c);
    if (result == PAGS_OK && progress && !progress(user, (double)(i + 1) / (double)count, "contributions"))
      result = pags_fail(PAGS_CANCELLED, "interrupted");
  }
  pags_frame_destroy(frame);
  free(ones);
  free(zeros);
  return result;
}
