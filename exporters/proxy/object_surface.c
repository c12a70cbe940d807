/* SPDX-License-Identifier: Apache-2.0 */
/* Reconstructs the closed surface of one labelled object from its Gaussians.
 *
 * The object's Gaussians are drawn alone by each training camera that had the object in view. The depth and the cover
 * of these views, without pixels where the rest of the scene hides the object, are fused in the box's frame into a
 * TSDF (tsdf.h). Space that no camera saw is completed by the shape prior (shape_prior.h), so the surface is always
 * closed. */
#include "exporters/proxy/object_proxy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

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

void pags_object_label_pose(const pags_scene *scene, const pags_object *object, int64_t label, double out[12]) {
  const pags_keyframe *keyframe = &object->keyframes[label];
  if (!pags_object_pose(object, keyframe->time, out))
    memcpy(out, keyframe->world_from_object, 12 * sizeof *out);
  pags_pose_subtract(out, scene->origin);
}

pags_result pags_gaussians_select(const pags_gaussians *from, const uint8_t *taken, bool wanted, pags_gaussians *out) {
  int64_t count = 0;
  PAGS_AUTOFREE int64_t *index = malloc(((size_t)from->count + 1) * sizeof *index);
  PAGS_CHECK_MEMORY(index, "%lld Gaussians", (long long)from->count);
  for (int64_t i = 0; i < from->count; i++)
    if ((taken[i] != 0) == wanted)
      index[count++] = i;
  PAGS_TRY(pags_gaussians_create_like(out, count, from));
  pags_gaussians_gather(from, index, count, out);
  return PAGS_OK;
}

/* Whether Gaussian `i` belongs to the parked object. */
static bool is_its_own(const double object_from_scene[12], const double size[3], const pags_gaussians *g, int64_t i,
                       int64_t object) {
  const int32_t id = g->object_id ? g->object_id[i] : -1;
  double p[3], q[3];
  if (id != object && id >= 0)
    return false;
  pags_gaussian_mean(g, i, p);
  pags_rigid_point(object_from_scene, p, q);
  for (int k = 0; k < 3; k++)
    if (fabs(q[k]) - 0.5 * size[k] > (id == object ? margin : 0))
      return false;
  return q[2] > -0.5 * size[2] + (id == object ? -margin : lift);
}

void pags_object_mark(const pags_proxy_maker *maker, int64_t object, uint8_t *taken) {
  const pags_object *record = &maker->scene->objects[object].record;
  const pags_gaussians *g = &maker->scene->models[0].gaussians;
  double pose[12], object_from_scene[12];
  pags_object_label_pose(maker->scene, record, record->keyframe_count / 2, pose);
  pags_rigid_inverse(pose, object_from_scene);
  for (int64_t i = 0; i < g->count; i++)
    if (is_its_own(object_from_scene, record->size, g, i, object))
      taken[i] = 1;
}

/* ---- Depth views and fusion ---- */

/* Makes the camera of a view in the object's frame at the view's time, cropped to the box of half extents `reach` and
 * scaled down to at most MOST_SIDE pixels. Returns false if the view is held out, the object has no pose at that time,
 * or it covers less than 6 x 6 pixels. */
static bool camera_of(const pags_object *object, const pags_scene_view *view, const double reach[3], pags_camera *out) {
  double world_from_object[12], object_from_world[12], lo[3];
  pags_camera camera = view->camera;
  camera.lens = (pags_lens_model){0}; /* depth views are pinholes, also of views with a lens */
  if (view->test || !pags_object_pose(object, camera.time, world_from_object))
    return false;
  pags_rigid_inverse(world_from_object, object_from_world);
  pags_rigid_multiply(object_from_world, view->camera.world_from_camera, camera.world_from_camera);
  pags_scale3(-1, reach, lo);
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
 * them. Pixels hidden by the rest of the scene, and the shadow under a vehicle, are marked as unknown or free. */
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
      PAGS_TRY(pags_depth_views_add(&shape->depth_views, w->frame, part, 1, &camera, &drawing, v, false));
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
  const pags_scene_object *o = &w->scene->objects[object];
  double reach[3];
  pags_part part = {.gaussians = &shape->gaussians, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  if (o->model >= 0) {
    PAGS_TRY(pags_gaussians_sorted_copy(&shape->gaussians, &w->scene->models[o->model].gaussians));
  } else if (w->scene->model_count > 0) {
    /* A parked object without a model of its own: take its Gaussians out of the background model. */
    const pags_gaussians *g = &w->scene->models[0].gaussians;
    double pose[12];
    PAGS_AUTOFREE uint8_t *taken = calloc((size_t)g->count + 1, 1);
    PAGS_CHECK_MEMORY(taken, "%lld Gaussians", (long long)g->count);
    pags_object_mark(w, object, taken);
    PAGS_TRY(pags_gaussians_select(g, taken, true, &shape->gaussians));
    pags_object_label_pose(w->scene, &o->record, o->record.keyframe_count / 2, pose);
    pags_rigid_inverse(pose, part.world_from_model);
  }

  /* The mean semantic priority. */
  double sum = 0;
  for (int64_t i = 0; shape->gaussians.s_sem && i < shape->gaussians.count; i++)
    sum += (double)shape->gaussians.s_sem[i];
  shape->s_sem = shape->gaussians.s_sem && shape->gaussians.count ? sum / (double)shape->gaussians.count : (double)NAN;

  reach_of(&o->record, reach);
  if (shape->gaussians.count >= PAGS_LEAST_GAUSSIANS) {
    PAGS_AUTO(pags_clusters_destroy) pags_clusters clusters = {0};
    PAGS_TRY(pags_clusters_create(&clusters, shape->gaussians.count, CLUSTER));
    pags_clusters_update(&clusters, &shape->gaussians, 0, clusters.count);
    part.clusters = &clusters;
    PAGS_TRY(look(w, object, &part, reach, shape));
  }

  /* The number of pixels with a depth says whether the object was seen enough. */
  for (int64_t i = 0; i < shape->depth_views.count; i++) {
    const pags_depth_view *s = &shape->depth_views.list[i];
    for (int64_t p = 0; p < (int64_t)s->camera.width * s->camera.height; p++)
      shape->surface_pixels += s->depth[p] > 0;
  }

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
  PAGS_TRY(pags_tsdf_create(grid, lo, hi, shape->voxel, false));
  return pags_tsdf_fuse(grid, &shape->depth_views, 4 * shape->voxel, 4 * shape->voxel, HUGE_VAL, true, w->tasks);
}

/* ---- The surface ---- */

/* Completes the grid by the shape prior and extracts the surface. A vehicle that was hardly seen becomes the blended
 * prior of its size; another object that was hardly seen gets no surface. */
pags_result pags_object_shape_make(const pags_proxy_maker *maker, int64_t object, pags_object_shape *shape) {
  const pags_object *record = &maker->scene->objects[object].record;
  const bool vehicle = record->category == PAGS_CATEGORY_VEHICLE;
  const pags_lidar_fit *cloud = maker->lidar.objects ? &maker->lidar.objects[object] : NULL;
  PAGS_AUTO(pags_tsdf_destroy) pags_tsdf grid = {0};
  PAGS_AUTO(pags_shape_prior_destroy) pags_shape_prior prior = {0};
  *shape = (pags_object_shape){0};
  PAGS_TRY(look_and_fuse(maker, object, shape, &grid));
  if (vehicle)
    PAGS_TRY(pags_shape_prior_blend(maker->priors, maker->prior_count, record->size, object, cloud, &prior));
  const bool enough = shape->surface_pixels >= LEAST_PIXELS, few = shape->gaussians.count < PAGS_LEAST_GAUSSIANS;
  if (!enough && prior.distance)
    shape->note = few ? "too few Gaussians: the form of vehicles of its size"
                      : "hardly seen by the training cameras: the form of vehicles of its size";
  else if (!enough)
    shape->note = few ? "too few Gaussians: the labelled box" : "hardly seen by the training cameras: the labelled box";
  if (!enough && !prior.distance)
    return PAGS_OK;
  PAGS_TRY(pags_shape_prior_complete(&grid, record->size, vehicle, &prior, cloud));
  PAGS_TRY(pags_tsdf_surface(&grid, false, &shape->surface));
  PAGS_TRY(pags_proxy_mesh_keep_parts(&shape->surface, 0.1, 0.1, record->size));
  return pags_proxy_mesh_paint(&shape->surface, &shape->depth_views, 4 * shape->voxel, maker->tasks);
}

pags_result pags_object_prior_make(const pags_proxy_maker *maker, int64_t object, pags_shape_prior *out) {
  PAGS_AUTO(pags_tsdf_destroy) pags_tsdf grid = {0};
  PAGS_AUTO(pags_object_shape_destroy) pags_object_shape shape = {0};
  *out = (pags_shape_prior){0};
  PAGS_TRY(look_and_fuse(maker, object, &shape, &grid));
  return shape.surface_pixels >= LEAST_PIXELS
             ? pags_shape_prior_take(&grid, maker->scene->objects[object].record.size, object, out)
             : PAGS_OK;
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
