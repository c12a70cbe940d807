/* SPDX-License-Identifier: Apache-2.0 */
/* Tells the classes of the background's surface. With semantic pictures a vertex has the class that most of the views
 * that see it show; without, it is guessed from its normal and colour. */
#include "exporters/proxy/background.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "exporters/proxy/tsdf.h"
#ifdef PAGS_WITH_IMAGES
#include <pags/image.h>
#endif

enum {
  ROAD = PAGS_CHUNK_ROAD,
  SIDEWALK = PAGS_CHUNK_SIDEWALK,
  BUILDING = PAGS_CHUNK_BUILDING,
  VEGETATION = PAGS_CHUNK_VEGETATION,
  POLE = PAGS_CHUNK_POLE,
  OTHER = PAGS_CHUNK_OTHER,
  CLASSES
};
const char *const pags_class_names[PAGS_CHUNK_CLASSES] = {"road", "sidewalk", "building", "vegetation",
                                                          "pole", "other",    "surface"};

uint8_t pags_class_of_label(uint8_t label) {
  static const uint8_t classes[] = {ROAD, SIDEWALK, BUILDING, BUILDING,   BUILDING,
                                    POLE, POLE,     POLE,     VEGETATION, VEGETATION};
  return label < sizeof classes ? classes[label] : CLASSES;
}

void pags_classes_load(const pags_proxy_maker *w, const pags_scene_view *view, pags_depth_view *depth_view) {
#ifdef PAGS_WITH_IMAGES
  char path[1024];
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  const char *name = pags_path_name(view->name);
  int stem = (int)(strlen(name) - strlen(pags_path_extension(name)));
  int width = depth_view->camera.width, height = depth_view->camera.height;
  if (!w->scene->dataset)
    return;
  snprintf(path, sizeof path, "%s/semantic/%.*s.png", w->scene->dataset, stem, name);
  if (!pags_file_exists(path) || pags_image_load(path, PAGS_U8, 1, &image) != PAGS_OK)
    return;
  depth_view->labels = malloc((size_t)width * (size_t)height);
  for (int y = 0; depth_view->labels && y < height; y++)
    for (int x = 0; x < width; x++) {
      /* Of two pixels that meet at the middle of this one, now this and now that: no border is shifted. */
      const int odd = (x + y) & 1;
      int u = ((2 * x + 1) * image.width - odd) / (2 * width), v = ((2 * y + 1) * image.height - odd) / (2 * height);
      depth_view->labels[(size_t)y * (size_t)width + (size_t)x] =
          ((const uint8_t *)image.data)[(size_t)v * (size_t)image.width + (size_t)u];
    }
#else
  (void)w, (void)view, (void)depth_view;
#endif
}

typedef struct naming {
  const pags_proxy_mesh *mesh;
  const pags_depth_views *depth_views;
  double tolerance;
  uint8_t *class_of; /* the class of each vertex */
  int64_t *lists;    /* of views, one for each worker */
} naming;

/* The class that most of the views that see a point give it (depth within the tolerance); OTHER if none does. */
static uint8_t vote(const naming *n, const int64_t *seen, int64_t seen_count, const double point[3]) {
  int votes[CLASSES] = {0}, best = 0, x, y;
  double z;
  for (int64_t s = 0; s < seen_count; s++) {
    const pags_depth_view *depth_view = &n->depth_views->list[seen[s]];
    if (!depth_view->labels || !pags_depth_view_project(depth_view, point, &x, &y, &z))
      continue;
    int64_t pixel = (int64_t)y * depth_view->camera.width + x;
    const uint8_t own = pags_class_of_label(depth_view->labels[pixel]);
    if (fabs((double)depth_view->depth[pixel] - z) < n->tolerance && own < CLASSES)
      votes[own]++;
  }
  for (int c = 1; c < CLASSES; c++)
    best = votes[c] > votes[best] ? c : best;
  return votes[best] ? (uint8_t)best : OTHER;
}

static void name_vertices(void *context, int64_t begin, int64_t end, int worker) {
  const naming *n = context;
  int64_t *seen = n->lists + worker * (n->depth_views->count + 1);
  int64_t seen_count = pags_depth_views_of_run(n->depth_views, n->mesh, begin, end, seen);
  for (int64_t i = begin; i < end; i++) {
    double point[3];
    pags_proxy_mesh_point(n->mesh, i, point);
    n->class_of[i] = vote(n, seen, seen_count, point);
  }
}

pags_result pags_classes_find(const pags_proxy_maker *w, const pags_depth_views *depth_views, bool labelled,
                              const pags_proxy_mesh *mesh, uint8_t *class_of) {
  if (labelled) {
    PAGS_AUTOFREE int64_t *lists = NULL;
    PAGS_TRY(pags_depth_views_lists(depth_views, w->tasks, &lists));
    naming n = {mesh, depth_views, 3 * w->options->voxel, class_of, lists};
    return pags_proxy_for(w->tasks, mesh->vertex_count, 256, name_vertices, &n);
  }
  PAGS_AUTOFREE float *normals = malloc(((size_t)mesh->vertex_count + 1) * 3 * sizeof *normals);
  PAGS_CHECK_MEMORY(normals, "%lld vertices", (long long)mesh->vertex_count);
  pags_proxy_mesh_normals(mesh, normals);
  /* Without semantic pictures a level surface is guessed to be road, an upright one that isn't green a building, a
   * green one vegetation, any other `other`. Poles are not recognised. */
  for (int64_t i = 0; i < mesh->vertex_count; i++) {
    const float *color = mesh->colors + 3 * i, up = normals[3 * i + 2];
    const bool green = color[1] > 1.05f * color[0] && color[1] > color[2];
    class_of[i] = up > 0.9f ? ROAD : green ? VEGETATION : fabsf(up) < 0.35f ? BUILDING : OTHER;
  }
  return PAGS_OK;
}
