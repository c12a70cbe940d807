/* SPDX-License-Identifier: Apache-2.0 */
/* Finds the contents of a scene for its report; see page.h. */
#include "cli/html_report/page.h"

#include <math.h>

#include "base/file.h"
#include "base/memory.h"
#include "cli/measure/info.h"
#include "maths/maths.h"

static const double size_least = -4, size_most = 3; /* 0.1 mm to 1 km */

/* 0 for a file that can't be looked at. */
static double file_size(const char *folder, const char *name) {
  uint64_t bytes = 0;
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  return path && pags_file_size(path, &bytes) == PAGS_OK ? (double)bytes : 0;
}

static int bin_of(double share, int bins) {
  const double at = floor(share * bins);
  return at > 0 ? at < bins ? (int)at : bins - 1 : 0;
}

/* Turns counts into per cent of `whole`, and fills the edges. */
static void finish(double (*points)[2], int bins, double lo, double hi, double whole) {
  for (int i = 0; i <= bins; i++) {
    points[i][0] = lo + (hi - lo) * i / bins;
    points[i][1] *= whole > 0 ? 100 / whole : 0;
  }
}

pags_result pags_scene_contents_find(const char *path, const pags_scene *scene, pags_scene_contents *out) {
  double known = 0;
  const bool folder = pags_dir_exists(path);
  *out = (pags_scene_contents){.bytes = folder ? file_size(path, "scene.json") : file_size(".", path)};
  if (folder && scene->sky.size > 0)
    out->bytes += file_size(path, "sky.npy");
  for (int64_t m = 0; m < scene->model_count; m++) {
    const pags_gaussians *g = &scene->models[m].gaussians;
    if (folder && scene->models[m].file)
      out->bytes += file_size(path, scene->models[m].file);
    for (int64_t i = 0; i < g->count; i++) {
      const float *scale = pags_plane(g, PAGS_SCALE) + i;
      const double largest = fmax(fmax((double)scale[0], (double)scale[g->stride]), (double)scale[2 * g->stride]);
      const double decades = largest / pags_log(10);
      out->sizes[bin_of((decades - size_least) / (size_most - size_least), PAGS_SIZE_BINS)][1]++;
      if (g->s_sem)
        out->priorities[bin_of((double)g->s_sem[i], PAGS_PRIORITY_BINS)][1]++;
    }
    out->gaussians += g->count;
    known += g->s_sem ? (double)g->count : 0;
    out->has_priorities = out->has_priorities || g->s_sem;
  }
  finish(out->priorities, PAGS_PRIORITY_BINS, 0, 1, known);
  finish(out->sizes, PAGS_SIZE_BINS, size_least, size_most, (double)out->gaussians);
  return pags_scene_object_gaussians(scene, &out->of_object);
}
