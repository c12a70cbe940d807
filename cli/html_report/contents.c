/* SPDX-License-Identifier: Apache-2.0 */
/* Implements contents.h. */
#include "cli/html_report/contents.h"

#include <math.h>
#include <stdlib.h>

#include "base/file.h"
#include "base/memory.h"
#include "cli/measure/info.h"
#include "maths/maths.h"

static const double size_least = -4, size_most = 3; /* 0.1 mm to 1 km */

static double file_size(const char *folder, const char *name) {
  uint64_t bytes = 0;
  char *path = pags_path_join(folder, name);
  if (!path || pags_file_size(path, &bytes) != PAGS_OK)
    bytes = 0;
  free(path);
  return (double)bytes;
}

/* Bytes of the files; 0 of what can't be looked at. */
static double count_bytes(const char *path, const pags_scene *scene) {
  if (!pags_dir_exists(path))
    return file_size(".", path);
  double bytes = file_size(path, "scene.json") + (scene->sky.size > 0 ? file_size(path, "sky.npy") : 0);
  for (int64_t i = 0; i < scene->model_count; i++)
    if (scene->models[i].file)
      bytes += file_size(path, scene->models[i].file);
  return bytes;
}

static int bin_of(double share, int bins) {
  const double at = floor(share * bins);
  return at > 0 ? at < bins ? (int)at : bins - 1 : 0;
}

static void count_model(const pags_gaussians *g, pags_scene_contents *out) {
  for (int64_t i = 0; i < g->count; i++) {
    const float *scale = pags_plane(g, PAGS_SCALE);
    double largest = -HUGE_VAL;
    for (int axis = 0; axis < 3; axis++, scale += g->stride)
      largest = fmax(largest, (double)scale[i]);
    const double decades = largest / pags_log(10);
    out->sizes[bin_of((decades - size_least) / (size_most - size_least), PAGS_SIZE_BINS)]++;
    if (g->s_sem)
      out->priorities[bin_of((double)g->s_sem[i], PAGS_PRIORITY_BINS)]++;
  }
  out->gaussians += g->count;
  out->has_priorities = out->has_priorities || g->s_sem;
}

/* Turns counts into per cent of `whole`, and fills the edges. */
static void finish(double *counts, double *edges, int bins, double lo, double hi, double whole) {
  for (int i = 0; i <= bins; i++) {
    edges[i] = lo + (hi - lo) * i / bins;
    counts[i] *= whole > 0 ? 100 / whole : 0;
  }
}

pags_result pags_scene_contents_find(const char *path, const pags_scene *scene, pags_scene_contents *out) {
  double known = 0;
  *out = (pags_scene_contents){.bytes = count_bytes(path, scene)};
  for (int64_t m = 0; m < scene->model_count; m++)
    count_model(&scene->models[m].gaussians, out);
  for (int i = 0; i < PAGS_PRIORITY_BINS; i++)
    known += out->priorities[i];
  finish(out->priorities, out->priority_edges, PAGS_PRIORITY_BINS, 0, 1, known);
  finish(out->sizes, out->size_edges, PAGS_SIZE_BINS, size_least, size_most, (double)out->gaussians);
  return pags_scene_object_gaussians(scene, &out->of_object);
}

void pags_scene_contents_destroy(pags_scene_contents *contents) {
  free(contents->of_object);
  *contents = (pags_scene_contents){0};
}
