/* SPDX-License-Identifier: Apache-2.0 */
/* Reconstructs the closed surface of one labelled object from its Gaussians.
 *
 * The object's Gaussians are drawn alone by each training camera that had the object in view. The depth and the cover
 * of these views, without pixels where the rest of the scene hides the object, are fused in the box's frame into a
 * TSDF (tsdf.h). Space that no camera saw is completed by the shape prior (shape_prior.h), so the surface is always
 * closed. */
#include "exporters/proxy/object_proxy.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/shadow_filter.h"

/* LEAST_PIXELS: an object with fewer surface pixels counts as hardly seen. CLUSTER: Gaussians a cluster. */
enum { LEAST_PIXELS = 64, CLUSTER = 64 };

/* Limits of the effort for one object: number of views, pixels along a view's longer side, grid steps along the
 * longest side of the box. */
enum { MOST_VIEWS = 64, MOST_SIDE = 320, STEPS = 128 };

/* Which Gaussians of the background are a parked object's, in metres. Labelled boxes may be tight, so a Gaussian with
 * the object's id may lie up to `margin` outside of the box. A Gaussian without an id must lie in the box and at
 * least `lift` above its lower face, since the road is there. */
static const double margin = 0.15, lift = 0.08;

void pags_object_shape_destroy(pags_object_shape *shape) {
  pags_gaussians_destroy(&shape->gaussians);
  pags_depth_views_destroy(&shape->depth_views);
  pags_proxy_mesh_destroy(&shape->surface);
  memset(shape, 0, sizeof *shape);
}

/* ---- The object's Gaussians ---- */

/* The pose of a parked object relative to the scene's origin: the pose of the middle one of its labels. */
static void parked_pose(const pags_proxy_maker *w, const pags_object *object, double out[12]) {
  const pags_keyframe *keyframe = &object->keyframes[object->keyframe_count / 2];
  if (!pags_object_pose(object, keyframe->time, out))
    memcpy(out, keyframe->world_from_object, 12 * sizeof *out);
  for (int k = 0; k < 3; k++)
    out[4 * k + 3] -= w->scene->origin[k];
}

/* Whether Gaussian `i`, whose object id is `id` (negative: none), belongs to the parked object. */
static bool is_its_own(const double object_from_scene[12], const double size[3], const float *x, const float *y,
                       const float *z, int64_t i, int32_t id, int64_t object) {
  const double p[3] = {(double)x[i], (double)y[i], (double)z[i]};
  double q[3];
  if (id != object && id >= 0)
    return false;
  for (int k = 0; k < 3; k++) {
    q[k] = object_from_scene[4 * k] * p[0] + object_from_scene[4 * k + 1] * p[1] + object_from_scene[4 * k + 2] * p[2] +
           object_from_scene[4 * k + 3];
    double beyond = fabs(q[k]) - 0.5 * size[k];
    if (beyond > (id == object ? margin : 0))
      return false;
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

/* ---- Depth views and fusion ---- */

/* Makes the camera of a view in the object's frame at the view's time, cropped to the box of half extents `reach` and
 * scaled down to at most MOST_SIDE pixels. Returns 0 if the view is held out, the object has no pose at that time, or
 * it covers less than 6 x 6 pixels. */
static bool camera_of(const pags_object *object, const pags_scene_view *view, const double reach[3], pags_camera *out) {
  double world_from_object[12], object_from_world[12], lo[3];
  pags_camera camera = view->camera;
  camera.lens = (pags_lens_model){0}; /* depth views are pinholes, also of views with a lens */
  if (view->test || !pags_object_pose(object, camera.time, world_from_object))
    return false;
  pags_rigid_inverse(world_from_object, object_from_world);
  pags_rigid_multiply(object_from_world, view->camera.world_from_camera, camera.world_from_camera);
  for (int k = 0; k < 3; k++)
    lo[k] = -reach[k];
  if (!pags_camera_crop(&camera, lo, reach, 0.2, out))
    return false;
  int side = out->width > out->height ? out->width : out->height;
  if (side > MOST_SIDE) { /* the pixels would be much finer than the grid */
    camera = pags_camera_downscale(&camera, (double)side / MOST_SIDE);
    if (!pags_camera_crop(&camera, lo, reach, 0.2, out))
      return false;
  }
  return out->width >= 6 && out->height >= 6;
}

/* Half extents of the space about the box's middle that is drawn and fused: the labelled box with a margin. */
static void reach_of(const pags_object *record, double reach[3]) {
  for (int k = 0; k < 3; k++)
    reach[k] = 0.5 * record->size[k] * 1.1 + margin;
}

/* Draws the object's depth views: all training views that have it in the picture, or an even choice of MOST_VIEWS of
 * them. What the rest of the scene hides, and the shadow under a vehicle, is marked as unknown or free. */
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

/* Gathers the object's Gaussians, draws its depth views and fuses them into `grid`. The weight stays 0 at grid points
 * that no view saw. */
static pags_result look_and_fuse(const pags_proxy_maker *w, int64_t object, pags_object_shape *shape, pags_tsdf *grid) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const pags_scene_object *o = &w->scene->objects[object];
  double pose[12], model_pose[12], reach[3];
  memcpy(model_pose, identity, sizeof model_pose);
  if (o->model >= 0) {
    PAGS_TRY(pags_gaussians_sorted_copy(&shape->gaussians, &w->scene->models[o->model].gaussians));
  } else if (w->scene->model_count > 0) {
    parked_pose(w, &o->record, pose);

    /* A parked object without a model of its own: take its Gaussians out of the background model. */
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

  /* The mean semantic priority. */
  double sum = 0;
  for (int64_t i = 0; shape->gaussians.s_sem && i < shape->gaussians.count; i++)
    sum += (double)shape->gaussians.s_sem[i];
  shape->s_sem = shape->gaussians.s_sem && shape->gaussians.count ? sum / (double)shape->gaussians.count : (double)NAN;

  reach_of(&o->record, reach);
  if (shape->gaussians.count >= PAGS_LEAST_GAUSSIANS) {
    pags_clusters clusters;
    PAGS_TRY(pags_clusters_create(&clusters, shape->gaussians.count, CLUSTER));
    pags_clusters_update(&clusters, &shape->gaussians, 0, clusters.count);
    pags_part part = {.gaussians = &shape->gaussians, .clusters = &clusters};
    memcpy(part.world_from_model, model_pose, sizeof part.world_from_model);
    pags_result result = look(w, object, &part, reach, shape);
    pags_clusters_destroy(&clusters);
    PAGS_TRY(result);
  }

  /* The number of pixels with a depth says whether the object was seen enough. */
  int64_t count = 0;
  for (int64_t i = 0; i < shape->depth_views.count; i++)
    for (int64_t p = 0; p < (int64_t)shape->depth_views.list[i].camera.width * shape->depth_views.list[i].camera.height;
         p++)
      count += shape->depth_views.list[i].depth[p] > 0;
  shape->surface_pixels = count;

  /* Fuse all depth views into a grid about the box's middle. */
  double lo[3], hi[3], longest = fmax(o->record.size[0], fmax(o->record.size[1], o->record.size[2]));
  shape->voxel = fmax(0.02, longest / STEPS);
  for (int k = 0; k < 3; k++) {
    /* The grid has an odd number of points along each axis, symmetric about 0, so that the mirror image of a grid
     * point is a grid point. `hi` is half a step short, so that rounding can't add a point. */
    double half = ceil(reach[k] / shape->voxel) * shape->voxel;
    lo[k] = -half;
    hi[k] = half - 0.5 * shape->voxel;
  }
  PAGS_TRY(pags_tsdf_create(grid, lo, hi, shape->voxel, 0));
  return pags_tsdf_fuse(grid, &shape->depth_views, 4 * shape->voxel, 4 * shape->voxel, HUGE_VAL, 1, w->tasks);
}

/* ---- The surface ---- */

/* The LiDAR points on the object; NULL if there is no LiDAR. */
static const pags_lidar_fit *cloud_of(const pags_proxy_maker *w, int64_t object) {
  return w->lidar.objects ? &w->lidar.objects[object] : NULL;
}

/* Completes the grid by the shape prior and extracts the surface. A vehicle that was hardly seen becomes the blended
 * prior of its size; another object that was hardly seen gets no surface. */
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
  return pags_proxy_mesh_paint(&shape->surface, &shape->depth_views, 4 * shape->voxel, w->tasks);
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
