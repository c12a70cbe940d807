/* SPDX-License-Identifier: Apache-2.0 */
/* Renders a picture for its pixels, or for the weights that the Gaussians have in it; see picture.h. */
#include "cli/draw/picture.h"

#include "base/memory.h"

pags_result pags_picture_render(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                const pags_frame_options *options, pags_picture *out) {
  const pags_part *parts;
  int count;
  pags_compose(composition, camera->time, &parts, &count);
  return pags_frame_render(frame, parts, count, camera, options, NULL, NULL, out);
}

typedef struct weighing {
  const pags_part *parts;
  pags_weight_fn *add;
  void *user;
} weighing;

/* Receives the scores of one cluster; no two clusters share a Gaussian. */
static void add_scores(void *user, const pags_cluster_score *score, int worker) {
  const weighing *const w = user;
  const pags_part *const part = &w->parts[score->part];
  (void)worker;
  for (int k = 0; k < score->count; k++) {
    const int64_t row = score->first + k;
    w->add(w->user, part->id ? part->id[row] : part->first_id + row, score->seen[k]);
  }
}

pags_result pags_picture_weights(pags_composition *composition, pags_frame *frame, const pags_camera *camera,
                                 const pags_frame_options *options, pags_weight_fn *add, void *user) {
  weighing w = {.add = add, .user = user};
  pags_frame_options kept = *options;
  pags_picture picture;
  int count;
  kept.keep_for_backward = 1;
  pags_compose(composition, camera->time, &w.parts, &count);
  PAGS_TRY(pags_frame_render(frame, w.parts, count, camera, &kept, NULL, NULL, &picture));
  const size_t pixels = (size_t)picture.stride * (((size_t)picture.height + 15) / 16 * 16);
  PAGS_AUTOFREE float *ones = calloc(2 * pixels, sizeof *ones); /* then zeros */
  PAGS_CHECK_MEMORY(ones, "a picture of %dx%d", picture.width, picture.height);
  for (size_t i = 0; i < pixels; i++)
    ones[i] = 1;
  const pags_score_planes planes = {.counted = ones, .critical = ones + pixels};
  return pags_frame_scores(frame, &planes, add_scores, &w);
}
