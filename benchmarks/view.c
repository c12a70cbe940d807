/* SPDX-License-Identifier: Apache-2.0 */
/* Renders a view again and again and keeps each stage's best time. */
#include "benchmarks/bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

static void ignore_gradient(void *user, const pags_cluster_gradient *gradient, int worker) {
  (void)user;
  (void)gradient;
  (void)worker;
}

/* A gradient of the size that a loss gives, different from pixel to pixel. */
static float *make_gradient(int stride, int rows) {
  const size_t size = (size_t)stride * (size_t)rows * 3;
  float *const gradient = malloc(size * sizeof *gradient);
  for (size_t i = 0; gradient && i < size; i++)
    gradient[i] = ((float)(i * 2654435761u >> 8 & 1023) - 511.5f) * 1e-9f;
  return gradient;
}

static void keep_least(double *best, double now) {
  *best = now < *best ? now : *best;
}

static void keep_times(pags_frame_stats *best, const pags_frame_stats *now) {
  keep_least(&best->ms_cull, now->ms_cull);
  keep_least(&best->ms_project, now->ms_project);
  keep_least(&best->ms_shade, now->ms_shade);
  keep_least(&best->ms_sort, now->ms_sort);
  keep_least(&best->ms_bin, now->ms_bin);
  keep_least(&best->ms_raster, now->ms_raster);
  keep_least(&best->ms_raster_backward, now->ms_raster_backward);
  keep_least(&best->ms_project_backward, now->ms_project_backward);
}

static pags_result measure_camera(const pags_bench_view *view, const pags_camera *camera, int backward,
                                  pags_frame *frame, pags_frame_stats *out) {
  pags_frame_options options = view->options;
  options.keep_for_backward = backward;
  options.count_pairs = 1;
  pags_picture picture;
  PAGS_TRY(pags_frame_render(frame, view->parts, view->part_count, camera, &options, NULL, NULL, &picture));
  *out = *pags_frame_stats_get(frame);
  out->ms_cull = out->ms_project = out->ms_shade = out->ms_sort = out->ms_bin = out->ms_raster = INFINITY;
  out->ms_raster_backward = out->ms_project_backward = backward ? INFINITY : 0.0;
  options.count_pairs = 0;
  const int rows = (camera->height + 15) / 16 * 16;
  float *const gradient = backward ? make_gradient(picture.stride, rows) : NULL;
  if (backward && !gradient)
    return pags_out_of_memory("a gradient");
  const size_t plane = (size_t)picture.stride * (size_t)rows;
  const pags_picture_gradient planes = {
      .rgb = {gradient, backward ? gradient + plane : NULL, backward ? gradient + 2 * plane : NULL}};
  pags_result result = PAGS_OK;
  for (int i = 0; i < view->repetitions && result == PAGS_OK; i++) {
    result = pags_frame_render(frame, view->parts, view->part_count, camera, &options, NULL, NULL, &picture);
    if (result == PAGS_OK && backward)
      result = pags_frame_backward(frame, &planes, ignore_gradient, NULL, NULL);
    if (result == PAGS_OK)
      keep_times(out, pags_frame_stats_get(frame));
  }
  free(gradient);
  return result;
}

static void add_share(pags_frame_stats *sum, const pags_frame_stats *one) {
  sum->ms_cull += one->ms_cull, sum->ms_project += one->ms_project, sum->ms_shade += one->ms_shade;
  sum->ms_sort += one->ms_sort, sum->ms_bin += one->ms_bin, sum->ms_raster += one->ms_raster;
  sum->ms_raster_backward += one->ms_raster_backward, sum->ms_project_backward += one->ms_project_backward;
  sum->gaussians += one->gaussians, sum->loaded += one->loaded, sum->shaded += one->shaded, sum->binned += one->binned;
  sum->pairs_binned += one->pairs_binned, sum->pairs_evaluated += one->pairs_evaluated;
  sum->pairs_blended += one->pairs_blended;
}

static void divide(pags_frame_stats *s, int n) {
  s->ms_cull /= n, s->ms_project /= n, s->ms_shade /= n, s->ms_sort /= n, s->ms_bin /= n, s->ms_raster /= n;
  s->ms_raster_backward /= n, s->ms_project_backward /= n;
  s->gaussians /= n, s->loaded /= n, s->shaded /= n, s->binned /= n;
  s->pairs_binned /= n, s->pairs_evaluated /= n, s->pairs_blended /= n;
}

pags_result pags_bench_measure(const pags_bench_view *view, int backward, pags_bench_frame *out) {
  memset(out, 0, sizeof *out);
  pags_frame *frame;
  PAGS_TRY(pags_frame_create(view->tasks, &frame));
  pags_result result = PAGS_OK;
  for (int c = 0; c < view->camera_count && result == PAGS_OK; c++) {
    pags_frame_stats one;
    result = measure_camera(view, view->cameras + c, backward, frame, &one);
    if (result == PAGS_OK)
      add_share(&out->stats, &one);
    out->pixels += (double)view->cameras[c].width * view->cameras[c].height / view->camera_count;
  }
  divide(&out->stats, view->camera_count);
  for (int p = 0; p < view->part_count; p++)
    out->clusters += (double)view->parts[p].clusters->count;
  out->bytes = pags_frame_bytes(frame);
  pags_frame_destroy(frame);
  return result;
}
