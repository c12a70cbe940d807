/* SPDX-License-Identifier: Apache-2.0 */
/* Contents of a scene: Gaussians per object, histograms of priorities and sizes, bytes of the files. */
#ifndef PAGS_CLI_HTML_REPORT_CONTENTS_H
#define PAGS_CLI_HTML_REPORT_CONTENTS_H

#include <pags/scene.h>
#include <stdbool.h>

enum { PAGS_PRIORITY_BINS = 20, PAGS_SIZE_BINS = 28 };

/* Edges and heights, in per cent of the Gaussians; the last height is no bin's. */
typedef struct pags_scene_contents {
  int64_t gaussians;
  double bytes;       /* of scene.json, models and sky, or of the splat file */
  int64_t *of_object; /* Gaussians of each of the scene's objects: of its own model, or its share of the background */
  bool has_priorities;
  double priority_edges[PAGS_PRIORITY_BINS + 1], priorities[PAGS_PRIORITY_BINS + 1];
  /* Decimal logarithms of the largest standard deviation, metres, of each Gaussian; what is beyond either end is in the
   * bin at that end. */
  double size_edges[PAGS_SIZE_BINS + 1], sizes[PAGS_SIZE_BINS + 1];
} pags_scene_contents;

/* `path` is the scene's folder or file, `scene` as it was loaded. PAGS_ERROR_MEMORY; `out` must be destroyed then, too.
 */
pags_result pags_scene_contents_find(const char *path, const pags_scene *scene, pags_scene_contents *out);
void pags_scene_contents_destroy(pags_scene_contents *contents);

#endif
