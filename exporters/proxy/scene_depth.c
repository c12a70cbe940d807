/* SPDX-License-Identifier: Apache-2.0 */
/* Draws the whole scene's depth in each training view, and removes from depth views of a single object or of the
 * background the pixels that the rest of the scene hides. */
#include "exporters/proxy/scene_depth.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/half.h"
#include "base/memory.h"
#include "base/vec3.h"

enum { CLUSTER = 64 };

static const float query = 0.5f;          /* least alpha of a pixel that has a depth */
static const float least_low_pass = 0.1f; /* px^2: with a smaller one, small Gaussians would fall between pixels */

void pags_scene_depth_destroy(pags_scene_depth *scene_depth) {
  for (int64_t i = 0; i < scene_depth->count; i++)
    free(scene_depth->views[i].depth);
  free(scene_depth->views);
  memset(scene_depth, 0, sizeof *scene_depth);
}

pags_frame_options pags_drawing_at(const pags_frame_options *drawing, const pags_camera *trained,
                                   const pags_camera *drawn) {
  pags_frame_options out = *drawing;
  double scale = drawn->fx / trained->fx;
  if (scale < 1)
    out.low_pass = fmaxf((float)(scale * scale) * out.low_pass, fminf(least_low_pass, out.low_pass));
  return out;
}

/* Sorted copies of the scene's models with clusters, and room for the parts of a view. */
typedef struct layout {
  int64_t count;
  pags_gaussians *models;
  pags_clusters *clusters;
  pags_part *parts;
} layout;

static void forget_layout(layout *l) {
  for (int64_t i = 0; i < l->count; i++) {
    pags_gaussians_destroy(&l->models[i]);
    pags_clusters_destroy(&l->clusters[i]);
  }
  free(l->models);
  free(l->clusters);
  free(l->parts);
}

static pags_result draw_view(const pags_scene *scene, const layout *l, pags_frame *frame,
                             const pags_frame_options *drawing, const pags_camera *trained,
                             pags_scene_depth_view *view) {
  pags_picture picture;
  const pags_camera *camera = &view->camera;
  pags_frame_options options = pags_drawing_at(drawing, trained, camera);
  options.sh_degree = 0;
  /* The parts: the background, and the models of the objects that have a pose at that time. */
  int count = 0;
  l->parts[count++] = (pags_part){.gaussians = &l->models[0],
                                  .clusters = &l->clusters[0],
                                  .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  for (int64_t o = 0; o < scene->object_count && count < l->count; o++) {
    double pose[12];
    int64_t model = scene->objects[o].model;
    if (model <= 0 || !pags_object_pose(&scene->objects[o].record, camera->time, pose))
      continue;
    pags_pose_subtract(pose, scene->origin);
    l->parts[count] = (pags_part){.gaussians = &l->models[model], .clusters = &l->clusters[model]};
    memcpy(l->parts[count++].world_from_model, pose, sizeof pose);
  }
  PAGS_TRY(pags_frame_render(frame, l->parts, count, camera, &options, NULL, NULL, &picture));
  view->depth = malloc((size_t)camera->width * (size_t)camera->height * sizeof *view->depth);
  PAGS_CHECK_MEMORY(view->depth, "a view of %dx%d", camera->width, camera->height);
  for (int y = 0; y < camera->height; y++)
    for (int x = 0; x < camera->width; x++) {
      int64_t from = (int64_t)y * picture.stride + x, to = (int64_t)y * camera->width + x;
      float alpha = 1 - picture.transmittance[from];
      view->depth[to] = pags_half_from_float(alpha >= query ? picture.depth[from] : INFINITY);
    }
  return PAGS_OK;
}

pags_result pags_scene_depth_draw(const pags_scene *scene, pags_frame *frame, const pags_frame_options *drawing,
                                  int widest, bool draw, pags_scene_depth *out) {
  PAGS_AUTO(forget_layout) layout l = {0};
  *out = (pags_scene_depth){.views = calloc((size_t)scene->view_count + 1, sizeof *out->views)};
  PAGS_CHECK_MEMORY(out->views, "%lld views", (long long)scene->view_count);
  out->count = scene->view_count;
  if (!scene->model_count)
    return PAGS_OK;
  const size_t models = (size_t)scene->model_count;
  l.models = calloc(models, sizeof *l.models);
  l.clusters = calloc(models, sizeof *l.clusters);
  l.parts = calloc(models, sizeof *l.parts);
  PAGS_CHECK_MEMORY(l.models && l.clusters && l.parts, "%lld models", (long long)scene->model_count);
  l.count = scene->model_count;
  for (int64_t i = 0; i < l.count; i++) {
    PAGS_TRY(pags_gaussians_sorted_copy(&l.models[i], &scene->models[i].gaussians));
    PAGS_TRY(pags_clusters_create(&l.clusters[i], l.models[i].count, CLUSTER));
    pags_clusters_update(&l.clusters[i], &l.models[i], 0, l.clusters[i].count);
  }
  for (int64_t v = 0; v < scene->view_count; v++) {
    const pags_camera *trained = &scene->views[v].camera;
    pags_camera *camera = &out->views[v].camera;
    if (scene->views[v].test)
      continue;
    *camera = pags_camera_downscale(trained, fmax(1, (double)trained->width / widest));
    camera->lens = (pags_lens_model){0}; /* depth views are pinholes, also of views with a lens */
    pags_pose_subtract(camera->world_from_camera, scene->origin);
    if (draw)
      PAGS_TRY(draw_view(scene, &l, frame, drawing, trained, &out->views[v]));
  }
  return PAGS_OK;
}

/* The least and the greatest depth of the four pixels around the ray with direction (u, v, 1). Returns false if the ray
 * is outside of the picture or none of the pixels has a depth. */
static bool bounds_at(const pags_scene_depth_view *view, double u, double v, double *nearest, double *farthest) {
  const pags_camera *c = &view->camera;
  double px = u * c->fx + c->cx - 0.5, py = v * c->fy + c->cy - 0.5;
  *nearest = HUGE_VAL;
  *farthest = 0;
  if (!(px > -1 && py > -1 && px < c->width && py < c->height))
    return false;
  for (int i = 0; i < 4; i++) {
    int x = (int)floor(px) + (i & 1), y = (int)floor(py) + (i >> 1);
    if (x < 0 || y < 0 || x >= c->width || y >= c->height)
      continue;
    double depth = (double)pags_float_from_half(view->depth[(int64_t)y * c->width + x]);
    *nearest = fmin(*nearest, depth);
    *farthest = fmax(*farthest, depth);
  }
  return *farthest > 0;
}

void pags_depth_view_hide(pags_depth_view *depth_view, const pags_scene_depth_view *view) {
  const pags_camera *c = &depth_view->camera;
  if (!view->depth)
    return;
  for (int y = 0; y < c->height; y++)
    for (int x = 0; x < c->width; x++) {
      double nearest, farthest;
      float *depth = &depth_view->depth[(int64_t)y * c->width + x];
      if (!bounds_at(view, (x + 0.5 - c->cx) / c->fx, (y + 0.5 - c->cy) / c->fy, &nearest, &farthest))
        continue;
      /* Rendered depths are blends of several Gaussians': a depth that is a little behind the scene's (2 % and 0.25
       * m) may be of the same surface. */
      const bool hidden = *depth > 0 && (double)*depth > 1.02 * farthest + 0.25;
      if ((hidden || *depth < 0) && nearest < (double)-PAGS_DEPTH_VIEW_FREE)
        *depth = (float)-nearest;
    }
  pags_depth_view_bound(depth_view);
}
