/* SPDX-License-Identifier: Apache-2.0 */
/* Leaves out Gaussians by place, opacity, size and support. A Gaussian is supported by the training views whose
 * picture its mean falls into; floaters in front of single cameras have few. */
#include "scene/filter.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

bool pags_filter_is_set(const pags_filter *filter) {
  return filter->has_box || filter->has_ball || filter->least_opacity > 0 || filter->least_size > 0 ||
         filter->greatest_size > 0 || filter->least_views > 0;
}

static bool is_within(const pags_filter *f, const double p[3]) {
  for (int k = 0; k < 3; k++)
    if (f->has_box && !(p[k] >= f->lo[k] && p[k] <= f->hi[k]))
      return false;
  return !f->has_ball || pags_distance_squared3(p, f->middle) <= f->radius * f->radius;
}

bool pags_filter_fits(const pags_filter *f, const pags_gaussians *g, int64_t i) {
  const double opacity = 1 / (1 + pags_exp(-(double)pags_plane(g, PAGS_OPACITY)[i]));
  double largest = -HUGE_VAL;
  for (int k = 0; k < 3; k++)
    largest = fmax(largest, (double)pags_plane(g, PAGS_SCALE + k)[i]);
  const double size = pags_exp(largest);
  return opacity >= f->least_opacity && size >= f->least_size && (f->greatest_size <= 0 || size <= f->greatest_size);
}

pags_result pags_support_find(const pags_scene *scene, pags_support *out) {
  *out = (pags_support){.cameras = malloc(((size_t)scene->view_count + 1) * sizeof *out->cameras),
                        .camera_from_scene = malloc(((size_t)scene->view_count + 1) * sizeof *out->camera_from_scene)};
  PAGS_CHECK_MEMORY(out->cameras && out->camera_from_scene, "%lld views", (long long)scene->view_count);
  for (int64_t v = 0; v < scene->view_count; v++) {
    if (scene->views[v].test)
      continue;
    double pose[12];
    memcpy(pose, scene->views[v].camera.world_from_camera, sizeof pose);
    pags_pose_subtract(pose, scene->origin);
    pags_rigid_inverse(pose, out->camera_from_scene[out->count]);
    out->cameras[out->count++] = &scene->views[v].camera;
  }
  return PAGS_OK;
}

pags_result pags_support_check(const pags_support *s, int least) {
  if (least && !s->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "the scene has no training views to count; expected a scene folder");
  return PAGS_OK;
}

bool pags_support_has(const pags_support *s, int least, const double mean[3]) {
  int seen = 0;
  for (int64_t v = 0; v < s->count && seen < least; v++) {
    double p[3];
    pags_rigid_point(s->camera_from_scene[v], mean, p);
    const pags_camera *c = s->cameras[v];
    if (!(p[2] > 0))
      continue;
    const double x = c->fx * p[0] / p[2] + c->cx, y = c->fy * p[1] / p[2] + c->cy;
    seen += x >= 0 && y >= 0 && x < c->width && y < c->height;
  }
  return seen >= least;
}

void pags_support_destroy(pags_support *s) {
  free(s->cameras);
  free(s->camera_from_scene);
  *s = (pags_support){0};
}

/* Whether the middle of an object's box is in the box and the ball. */
static bool object_is_within(const pags_scene *scene, int64_t object, const pags_filter *f, double time) {
  const pags_object *o = &scene->objects[object].record;
  double pose[12], p[3];
  if (!pags_object_pose(o, time, pose))
    memcpy(pose, o->keyframes[0].world_from_object, sizeof pose);
  pags_pose_position(pose, p);
  pags_add_scaled3(-1, scene->origin, p);
  return is_within(f, p);
}

static pags_result filter_model(pags_scene *scene, int64_t model, const pags_filter *f, double time,
                                const pags_support *s, int64_t *index) {
  pags_gaussians *g = &scene->models[model].gaussians;
  bool within = true;
  int64_t count = 0;
  for (int64_t o = 0; o < scene->object_count && model > 0; o++)
    if (scene->objects[o].model == model)
      within = object_is_within(scene, o, f, time);
  for (int64_t i = 0; i < g->count && within; i++) {
    double mean[3];
    pags_gaussian_mean(g, i, mean);
    if (pags_filter_fits(f, g, i) &&
        (model > 0 || (is_within(f, mean) && (!f->least_views || pags_support_has(s, f->least_views, mean)))))
      index[count++] = i;
  }
  return pags_gaussians_keep(g, index, count);
}

pags_result pags_scene_filter(pags_scene *scene, const pags_filter *filter, double time, uint8_t *chosen,
                              int64_t *left) {
  const int64_t before = pags_scene_gaussian_count(scene);
  PAGS_AUTO(pags_support_destroy) pags_support s = {0};
  *left = before;
  if (!pags_filter_is_set(filter))
    return PAGS_OK;
  PAGS_AUTOFREE int64_t *index = malloc(((size_t)before + 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)before);
  PAGS_TRY(pags_support_find(scene, &s));
  PAGS_TRY(pags_support_check(&s, filter->least_views));
  for (int64_t m = 0; m < scene->model_count; m++)
    PAGS_TRY(filter_model(scene, m, filter, time, &s, index));
  for (int64_t o = 0; o < scene->object_count && chosen; o++)
    chosen[o] = (uint8_t)(chosen[o] && object_is_within(scene, o, filter, time));
  *left = pags_scene_gaussian_count(scene);
  if (before && !*left)
    return pags_fail(PAGS_ERROR_ARGUMENT,
                     "none of the %lld Gaussians passes the limits of place, opacity, size and views",
                     (long long)before);
  return PAGS_OK;
}
