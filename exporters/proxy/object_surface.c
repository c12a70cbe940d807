/* SPDX-License-Identifier: Apache-2.0 */
/* Objects: which Gaussians are theirs, what the training cameras see of them, and a closed surface.
 *
 * Depth and cover of the object drawn alone by each training camera that had it in view, without what the rest of the
 * scene hides, are fused in the box's frame into a signed distance. What no camera saw is completed (shape_prior.h), so
 * the surface is closed whatever was seen. */
#include "exporters/proxy/object_proxy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/shadow_filter.h"

enum { LEAST_PIXELS = 64, CLUSTER = 64 };

/* How closely to look at an object: most views, pixels of their longer side, steps of the grid along the longest side
 * of the box. */
enum { MOST_VIEWS = 64, MOST_SIDE = 320, STEPS = 128 };

/* Labels are tight or loose: Gaussians up to this much beyond the box, and no closer to its lower face than this if
 * they aren't known to be the object's; metres. */
static const double margin = 0.15, lift = 0.08;

void pags_object_shape_destroy(pags_object_shape *shape) {
  pags_gaussians_destroy(&shape->gaussians);
  pags_depth_views_destroy(&shape->depth_views);
  pags_proxy_mesh_destroy(&shape->surface);
  memset(shape, 0, sizeof *shape);
}

/* Where a parked object stands: its middle label. */
static void parked_pose(const pags_proxy_maker *w, const pags_object *object, double out[12]) {
  const pags_knot *knot = &object->knots[object->knot_count / 2];
  if (!pags_object_pose(object, knot->time, out))
    memcpy(out, knot->world_from_object, 12 * sizeof *out);
  for (int k = 0; k < 3; k++)
    out[4 * k + 3] -= w->scene->origin[k];
}

static int is_its_own(const double object_from_scene[12], const double size[3], const float *x, const float *y,
                      const float *z, int64_t i, int32_t id, int64_t object) {
  const double p[3] = {(double)x[i], (double)y[i], (double)z[i]};
  double q[3];
  if (id != object && id >= 0)
    return 0;
  for (int k = 0; k < 3; k++) {
    q[k] = object_from_scene[4 * k] * p[0] + object_from_scene[4 * k + 1] * p[1] + object_from_scene[4 * k + 2] * p[2] +
           object_from_scene[4 * k + 3];
    double beyond = fabs(q[k]) - 0.5 * size[k];
    if (beyond > (id == object ? margin : 0))
      return 0;
  }
  return q[2] > -0.5 * size[2] + (id == object ? -margin : lift);
}

void pags_object_mark(const pags_proxy_maker *maker, int64_t object, uint8_t *taken) {
  const pags_object *record = &maker->scene->objects[object].record;
  const pags_gaussians *g = &maker->scene->models[0].gaussians;
  double pose[12], object_from_scene[12];
  parked_pose(maker, record, pose);
  pags_rigid_inverse(pose, object_from_scene);
  for (int64_t i = 0; i < g->count; i++)
    if (is_its_own(object_from_scene, record->size, pags_plane(g, PAGS_MEAN), pags_plane(g, PAGS_MEAN + 1),
                   pags_plane(g, PAGS_MEAN + 2), i, g->object_id ? g->object_id[i] : -1, object))
      taken[i] = 1;
}

/* The camera of a view in the object's frame at the view's time; 0 when the object isn't there or not in the picture.
 */
static int camera_of(const pags_object *object, const pags_scene_view *view, const double reach[3], pags_camera *out) {
  double world_from_object[12], object_from_world[12], lo[3];
  pags_camera camera = view->camera;
  if (view->test || !pags_object_pose(object, camera.time, world_from_object))
    return 0;
  pags_rigid_inverse(world_from_object, object_from_world);
  pags_rigid_multiply(object_from_world, view->camera.world_from_camera, camera.world_from_camera);
  for (int k = 0; k < 3; k++)
    lo[k] = -reach[k];
  if (!pags_camera_crop(&camera, lo, reach, 0.2, out))
    return 0;
  int side = out->width > out->height ? out->width : out->height;
  if (side > MOST_SIDE) { /* finer than the grid by far */
    camera = pags_camera_downscale(&camera, (double)side / MOST_SIDE);
    if (!pags_camera_crop(&camera, lo, reach, 0.2, out))
      return 0;
  }
  return out->width >= 6 && out->height >= 6;
}

/* Half of the room that is looked at about the box's middle. */
static void reach_of(const pags_object *record, double reach[3]) {
  for (int k = 0; k < 3; k++)
    reach[k] = 0.5 * record->size[k] * 1.1 + margin;
}

/* The views that have it in the picture; of too many an even choice. */
static pags_result look(const pags_proxy_maker *w, int64_t object, const pags_part *part, const double reach[3],
                        pags_object_shape *shape) {
  const pags_object *record = &w->scene->objects[object].record;
  int64_t count = 0, taken = 0;
  pags_camera camera;
  for (int64_t v = 0; v < w->scene->view_count; v++)
    count += camera_of(record, &w->scene->views[v], reach, &camera);
  for (int64_t v = 0, seen = 0; v < w->scene->view_count; v++) {
    if (!camera_of(record, &w->scene->views[v], reach, &camera))
      continue;
    if (count <= MOST_VIEWS || seen * MOST_VIEWS / count >= taken) {
      taken++;
      pags_frame_options drawing = pags_drawing_at(&w->drawing, &w->scene->views[v].camera, &camera);
      PAGS_TRY(pags_depth_views_add(&shape->depth_views, w->frame, part, 1, &camera, &drawing, v, 0));
      pags_depth_view *depth_view = &shape->depth_views.list[shape->depth_views.count - 1];
      pags_depth_view_hide(depth_view, &w->scene_depth.views[v]);
      if (record->category == PAGS_CATEGORY_VEHICLE)
        PAGS_TRY(pags_depth_view_filter_shadow(depth_view, record->size));
    }
    seen++;
  }
  return PAGS_OK;
}

/* Draws the object and fuses what is seen; weights stay 0 where nothing is. */
static pags_result look_and_fuse(const pags_proxy_maker *w, int64_t object, pags_object_shape *shape, pags_tsdf *grid) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const pags_scene_object *o = &w->scene->objects[object];
  double pose[12], model_pose[12], reach[3];
  memcpy(model_pose, identity, sizeof model_pose);
  if (o->model >= 0) {
    PAGS_TRY(pags_gaussians_sorted_copy(&shape->gaussians, &w->scene->models[o->model].gaussians));
  } else if (w->scene->model_count > 0) {
    parked_pose(w, &o->record, pose);

    /* Of the background, what is known as the parked object's and what lies in its box. */
    const pags_gaussians *g = &w->scene->models[0].gaussians;
    int64_t count = 0, *index = malloc(((size_t)g->count + 1) * sizeof *index);
    uint8_t *taken = calloc((size_t)g->count + 1, 1);
    pags_result result = index && taken ? PAGS_OK : pags_out_of_memory("%lld Gaussians", (long long)g->count);
    if (result == PAGS_OK) {
      pags_object_mark(w, object, taken);
      for (int64_t i = 0; i < g->count; i++)
        if (taken[i])
          index[count++] = i;
      result = pags_gaussians_create_like(&shape->gaussians, count, g);
    }
    if (result == PAGS_OK)
      pags_gaussians_gather(g, index, count, &shape->gaussians);
    free(index);
    free(taken);
    PAGS_TRY(result);

    pags_rigid_inverse(pose, model_pose);
  }

  /* Mean s sem. */
  double sum = 0;
  for (int64_t i = 0; shape->gaussians.s_sem && i < shape->gaussians.count; i++)
    sum += (double)shape->gaussians.s_sem[i];
  shape->s_sem = shape->gaussians.s_sem && shape->gaussians.count ? sum / (double)shape->gaussians.count : (double)NAN;

  reach_of(&o->record, reach);
  if (shape->gaussians.count >= PAGS_LEAST_GAUSSIANS) {
    /* Draw views. */
    pags_clusters clusters;
    PAGS_TRY(pags_clusters_create(&clusters, shape->gaussians.count, CLUSTER));
    pags_clusters_update(&clusters, &shape->gaussians, 0, clusters.count);
    pags_part part = {.gaussians = &shape->gaussians, .clusters = &clusters};
    memcpy(part.world_from_model, model_pose, sizeof part.world_from_model);
    pags_result result = look(w, object, &part, reach, shape);
    pags_clusters_destroy(&clusters);
    PAGS_TRY(result);
  }

  /* Count pixels. */
  int64_t count = 0;
  for (int64_t i = 0; i < shape->depth_views.count; i++)
    for (int64_t p = 0; p < (int64_t)shape->depth_views.list[i].camera.width * shape->depth_views.list[i].camera.height;
         p++)
      count += shape->depth_views.list[i].depth[p] > 0;
  shape->surface_pixels = count;

  /* Fuse. */
  double lo[3], hi[3], longest = fmax(o->record.size[0], fmax(o->record.size[1], o->record.size[2]));
  shape->voxel = fmax(0.02, longest / STEPS);
  for (int k = 0; k < 3; k++) { /* an odd number of points, even about 0, so that the mirror image falls on points */
    double half = ceil(reach[k] / shape->voxel) * shape->voxel;
    lo[k] = -half;
    hi[k] = half - 0.5 * shape->voxel;
  }
  PAGS_TRY(pags_tsdf_create(grid, lo, hi, shape->voxel, 0));
  return pags_tsdf_fuse(grid, &shape->depth_views, 4 * shape->voxel, HUGE_VAL, 1, w->tasks)
             ? PAGS_OK
             : pags_fail(PAGS_CANCELLED, "interrupted");
}

static const pags_lidar_fit *cloud_of(const pags_proxy_maker *w, int64_t object) {
  return w->lidar.objects ? &w->lidar.objects[object] : NULL;
}

static pags_result make_surface(const pags_proxy_maker *w, int64_t object, pags_object_shape *shape, pags_tsdf *grid) {
  const pags_object *record = &w->scene->objects[object].record;
  int vehicle = record->category == PAGS_CATEGORY_VEHICLE;
  pags_shape_prior prior = {0};
  if (vehicle)
    PAGS_TRY(pags_shape_prior_blend(w->priors, w->prior_count, record->size, object, cloud_of(w, object), &prior));
  int enough = shape->surface_pixels >= LEAST_PIXELS, possible = enough || prior.distance;
  int few = shape->gaussians.count < PAGS_LEAST_GAUSSIANS;
  if (!enough && possible)
    shape->note = few ? "too few Gaussians: the form of vehicles of its size"
                      : "hardly seen by the training cameras: the form of vehicles of its size";
  else if (!enough)
    shape->note = few ? "too few Gaussians: the labelled box" : "hardly seen by the training cameras: the labelled box";
  pags_result result =
      possible ? pags_shape_prior_complete(grid, record->size, vehicle, &prior, cloud_of(w, object)) : PAGS_OK;
  pags_shape_prior_destroy(&prior);
  if (!possible || result != PAGS_OK)
    return result;
  PAGS_TRY(pags_tsdf_surface(grid, 0, &shape->surface));
  PAGS_TRY(pags_proxy_mesh_keep_parts(&shape->surface, 0.1, 0.1, record->size));
  if (!pags_proxy_mesh_paint(&shape->surface, &shape->depth_views, 4 * shape->voxel, w->tasks))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  return PAGS_OK;
}

pags_result pags_object_shape_make(const pags_proxy_maker *maker, int64_t object, pags_object_shape *shape) {
  pags_tsdf grid = {0};
  *shape = (pags_object_shape){0};
  pags_result result = look_and_fuse(maker, object, shape, &grid);
  if (result == PAGS_OK)
    result = make_surface(maker, object, shape, &grid);
  pags_tsdf_destroy(&grid);
  return result;
}

pags_result pags_object_prior_make(const pags_proxy_maker *maker, int64_t object, pags_shape_prior *out) {
  pags_tsdf grid = {0};
  pags_object_shape shape = {0};
  *out = (pags_shape_prior){0};
  pags_result result = look_and_fuse(maker, object, &shape, &grid);
  if (result == PAGS_OK && shape.surface_pixels >= LEAST_PIXELS)
    result = pags_shape_prior_take(&grid, maker->scene->objects[object].record.size, object, out);
  pags_tsdf_destroy(&grid);
  pags_object_shape_destroy(&shape);
  return result;
}

double pags_object_pixels(const pags_proxy_maker *maker, int64_t object) {
  const pags_object *record = &maker->scene->objects[object].record;
  double reach[3], sum = 0;
  pags_camera camera;
  reach_of(record, reach);
  for (int64_t v = 0; v < maker->scene->view_count; v++)
    if (camera_of(record, &maker->scene->views[v], reach, &camera))
      sum += (double)camera.width * camera.height;
  return sum;
}
