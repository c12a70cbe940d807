/* SPDX-License-Identifier: Apache-2.0 */
/* Renders views repeatedly and keeps the minimum time of each stage, for pags-bench stages and roofline. */
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

/* Makes a pseudo-random picture gradient of the size that a loss gives. */
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
    if (result == PAGS_OK) {
      /* Keep the minimum of each stage's time. */
      const pags_frame_stats *now = pags_frame_stats_get(frame);
      keep_least(&out->ms_cull, now->ms_cull);
      keep_least(&out->ms_project, now->ms_project);
      keep_least(&out->ms_shade, now->ms_shade);
      keep_least(&out->ms_sort, now->ms_sort);
      keep_least(&out->ms_bin, now->ms_bin);
      keep_least(&out->ms_raster, now->ms_raster);
      keep_least(&out->ms_raster_backward, now->ms_raster_backward);
      keep_least(&out->ms_project_backward, now->ms_project_backward);
    }
  }
  free(gradient);
  return result;
}

pags_result pags_bench_measure(const pags_bench_view *view, int backward, pags_bench_frame *out) {
  memset(out, 0, sizeof *out);
  pags_frame *frame;
  PAGS_TRY(pags_frame_create(view->tasks, &frame));
  pags_result result = PAGS_OK;
  for (int c = 0; c < view->camera_count && result == PAGS_OK; c++) {
    pags_frame_stats one;
    result = measure_camera(view, view->cameras + c, backward, frame, &one);
    if (result == PAGS_OK) {
      /* Add the camera's times and counts to the sums. */
      out->stats.ms_cull += one.ms_cull, out->stats.ms_project += one.ms_project, out->stats.ms_shade += one.ms_shade;
      out->stats.ms_sort += one.ms_sort, out->stats.ms_bin += one.ms_bin, out->stats.ms_raster += one.ms_raster;
      out->stats.ms_raster_backward += one.ms_raster_backward,
          out->stats.ms_project_backward += one.ms_project_backward;
      out->stats.gaussians += one.gaussians, out->stats.loaded += one.loaded, out->stats.shaded += one.shaded,
          out->stats.binned += one.binned;
      out->stats.pairs_binned += one.pairs_binned, out->stats.pairs_evaluated += one.pairs_evaluated;
      out->stats.pairs_blended += one.pairs_blended;
    }
    out->pixels += (double)view->cameras[c].width * view->cameras[c].height / view->camera_count;
  }

  /* Divide the sums by the number of cameras. */
  out->stats.ms_cull /= view->camera_count, out->stats.ms_project /= view->camera_count,
      out->stats.ms_shade /= view->camera_count, out->stats.ms_sort /= view->camera_count,
      out->stats.ms_bin /= view->camera_count, out->stats.ms_raster /= view->camera_count;
  out->stats.ms_raster_backward /= view->camera_count, out->stats.ms_project_backward /= view->camera_count;
  out->stats.gaussians /= view->camera_count, out->stats.loaded /= view->camera_count,
      out->stats.shaded /= view->camera_count, out->stats.binned /= view->camera_count;
  out->stats.pairs_binned /= view->camera_count, out->stats.pairs_evaluated /= view->camera_count,
      out->stats.pairs_blended /= view->camera_count;

  for (int p = 0; p < view->part_count; p++)
    out->clusters += (double)view->parts[p].clusters->count;
  out->bytes = pags_frame_bytes(frame);
  pags_frame_destroy(frame);
  return result;
}
