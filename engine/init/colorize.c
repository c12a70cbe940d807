/* SPDX-License-Identifier: Apache-2.0 */
/* Colours LiDAR points from the training photographs.
 *
 * Every training photograph is loaded once, in order; all points are projected into it in parallel, and a z-buffer
 * tells which of them it shows. A point's colour is the weighted mean of its pixels over the photographs that show
 * it. The weight falls with the square of the depth (finer pixels count more) and with the time between the
 * photograph and the point's measurement (shadows move, labelled boxes drift). Pixels whose labels say that they show
 * something else (sky, an object) get a weight so small that they count only if there is no better one. */
#include "init/colorize.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"

enum { BLOCK = 4096, LONGEST_SIDE = 1200 };

static const float near_time = 0.5f;  /* seconds between photograph and measurement at which the weight is halved */
static const float doubtful = 1e-3f;  /* factor on the weight of a pixel that probably shows something else */
static const double near_plane = 0.1; /* metres */

/* Pose of the background or of a moving object (the owner of points) for the current photograph. */
typedef struct owner_pose {
  bool present; /* false: the object is not there at this time */
  float m[12];  /* camera from the owner's frame */
} owner_pose;

typedef struct colorizer {
  const pags_dataset *dataset;
  pags_tasks *tasks;
  pags_lidar_points *points;
  int64_t measured;  /* number of measured points, the first rows */
  double time_begin; /* of the first sweep, seconds */
  owner_pose *poses; /* the background's, then one for each object */
  pags_seen_point *seen;
  pags_z_buffer z_buffer;
  pags_photo photo;
  pags_camera camera;
} colorizer;

static void destroy(colorizer *p) {
  pags_z_buffer_destroy(&p->z_buffer);
  free(p->poses);
  free(p->seen);
}

/* ---- Projection and weights ---- */

static void set_motion(const colorizer *p, const double world_from_owner[12], owner_pose *out) {
  double inverse[12], m[12];
  pags_rigid_inverse(p->camera.world_from_camera, inverse);
  pags_rigid_multiply(inverse, world_from_owner, m);
  for (int i = 0; i < 12; i++)
    out->m[i] = (float)m[i];
  out->present = true;
}

/* Where a camera with a lens shows a point; its depth is the distance. */
static pags_seen_point see_through(const pags_camera *c, const float m[12], const float q[3]) {
  double own[3], at[2];
  for (int k = 0; k < 3; k++)
    own[k] = (double)(m[4 * k] * q[0] + m[4 * k + 1] * q[1] + m[4 * k + 2] * q[2] + m[4 * k + 3]);
  const double square = pags_dot3(own, own);
  if (!(square > near_plane * near_plane) || !pags_camera_project(c, own, at, NULL))
    return (pags_seen_point){0};
  const float u = (float)at[0], v = (float)at[1];
  const bool inside = u >= 0 && v >= 0 && u < (float)c->width && v < (float)c->height;
  return inside ? (pags_seen_point){u, v, (float)sqrt(square)} : (pags_seen_point){0};
}

static void project_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const colorizer *p = context;
  const pags_camera *c = &p->camera;
  const float fx = (float)c->fx, fy = (float)c->fy, cx = (float)c->cx, cy = (float)c->cy;
  const bool bends = pags_camera_bends(c);
  for (int64_t i = begin; i < end; i++) {
    const pags_lidar_point *row = &p->points->rows[i];
    const owner_pose *pose = &p->poses[1 + row->owner];
    const float *m = pose->m, *q = row->p;
    p->seen[i].z = 0;
    if (!pose->present)
      continue;
    if (bends) {
      p->seen[i] = see_through(c, m, q);
      continue;
    }
    float z = m[8] * q[0] + m[9] * q[1] + m[10] * q[2] + m[11];
    if (!(z > (float)near_plane))
      continue;
    float u = fx * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + m[3]) / z + cx;
    float v = fy * (m[4] * q[0] + m[5] * q[1] + m[6] * q[2] + m[7]) / z + cy;
    if (u >= 0 && v >= 0 && u < (float)c->width && v < (float)c->height)
      p->seen[i] = (pags_seen_point){u, v, z};
  }
}

/* Do the labels of a pixel say that it probably shows something other than the point's owner? For the background that
 * is any object's box, something moving or sky; for an object it is everything but a box of its own category alone,
 * since where boxes of several categories overlap, the labels do not tell which object is visible. */
static bool is_doubtful(const colorizer *p, const pags_lidar_point *row, int labels) {
  static const int bits[] = {[PAGS_CATEGORY_VEHICLE] = PAGS_LABEL_VEHICLE,
                             [PAGS_CATEGORY_PEDESTRIAN] = PAGS_LABEL_PEDESTRIAN,
                             [PAGS_CATEGORY_CYCLIST] = PAGS_LABEL_CYCLIST};
  const int boxes = PAGS_LABEL_VEHICLE | PAGS_LABEL_PEDESTRIAN | PAGS_LABEL_CYCLIST;
  if (row->owner < 0)
    return (labels & (boxes | PAGS_LABEL_MOVING | PAGS_LABEL_SKY)) != 0;
  int own = bits[pags_dataset_object(p->dataset, row->owner)->category];
  return (labels & (boxes | PAGS_LABEL_SKY)) != own && p->photo.labels;
}

/* ---- One photograph ---- */

/* Adds the colour of each point's pixel by a weight that is 0 where the pixel is masked out or the point is hidden.
 * Points of a grid, which need not lie on a surface, are coloured even where hidden, with the factor `doubtful`. Counts
 * the labelled views that show a point, and those of them whose pixel is labelled critical: the ratio of the two
 * becomes the initial s_sem. */
static void colorize_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const colorizer *p = context;
  const int64_t plane = (int64_t)p->photo.height * p->photo.stride;
  for (int64_t i = begin; i < end; i++) {
    const pags_seen_point *at = &p->seen[i];
    pags_lidar_point *row = &p->points->rows[i];
    if (!(at->z > 0))
      continue;
    const int64_t pixel = (int64_t)at->v * p->photo.stride + (int64_t)at->u;
    const int labels = p->photo.labels ? p->photo.labels[pixel] : 0;
    const bool visible = pags_z_buffer_visible(&p->z_buffer, at), masked = p->photo.mask && !p->photo.mask[pixel];
    if (masked || (!visible && row->kind != PAGS_CANDIDATE_GRID))
      continue;
    const float apart = (row->time - (float)(p->camera.time - p->time_begin)) / near_time;
    float weight = 1 / (at->z * at->z);
    if (isfinite(apart))
      weight /= 1 + apart * apart;
    if (!visible || is_doubtful(p, row, labels))
      weight *= doubtful;
    for (int c = 0; c < 3; c++)
      row->sum[c] += weight * (float)p->photo.rgb[c * plane + pixel];
    row->sum[3] += weight;
    if (p->photo.labels && visible) {
      row->views[0] += 1;
      row->views[1] += (labels & PAGS_LABEL_CRITICAL) != 0;
    }
  }
}

static pags_result colorize_view(colorizer *p, pags_photo_cache *photos, int64_t view, int shrink) {
  const pags_view *v = pags_dataset_view(p->dataset, view);
  PAGS_TRY(pags_photo_cache_get(photos, view, shrink, &p->photo));
  p->camera = shrink == 1 ? v->camera : pags_camera_downscale(&v->camera, shrink);

  /* Camera-from-owner poses of the background and of each moving object at the time of this photograph. */
  const double *origin = pags_dataset_origin(p->dataset);
  const double shifted[12] = {1, 0, 0, origin[0], 0, 1, 0, origin[1], 0, 0, 1, origin[2]};
  set_motion(p, shifted, &p->poses[0]);
  for (int64_t i = 0; i < pags_dataset_object_count(p->dataset); i++) {
    const pags_object *object = pags_dataset_object(p->dataset, i);
    double pose[12];
    p->poses[1 + i].present = false;
    if (object->moving && pags_object_pose(object, v->camera.time, pose))
      set_motion(p, pose, &p->poses[1 + i]);
  }

  PAGS_TRY(pags_z_buffer_reset(&p->z_buffer, p->photo.width, p->photo.height, p->camera.fx));
  if (!pags_parallel_for(p->tasks, p->points->count, BLOCK, project_block, p))
    return pags_fail(PAGS_CANCELLED, "cancelled while colouring points");
  pags_z_buffer_add(&p->z_buffer, p->seen, p->measured);
  if (!pags_parallel_for(p->tasks, p->points->count, BLOCK, colorize_block, p))
    return pags_fail(PAGS_CANCELLED, "cancelled while colouring points");
  return PAGS_OK;
}

/* ---- All photographs ---- */

pags_result pags_lidar_points_colorize(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_points *points,
                                       int64_t measured, pags_photo_cache *photos, pags_far_points *far) {
  PAGS_AUTO(destroy) colorizer p = {.dataset = dataset, .tasks = tasks, .points = points, .measured = measured};
  const size_t wanted = (size_t)(far->wanted > 0 ? far->wanted : 1);
  int64_t count = 0;
  p.poses = calloc((size_t)pags_dataset_object_count(dataset) + 1, sizeof *p.poses);
  p.seen = malloc((size_t)(points->count > 0 ? points->count : 1) * sizeof *p.seen);
  PAGS_AUTOFREE int64_t *views = malloc(((size_t)pags_dataset_view_count(dataset) + 1) * sizeof *views);
  far->count = 0;
  far->xyz = malloc(wanted * 3 * sizeof *far->xyz);
  far->rgb = malloc(wanted * 3);
  PAGS_CHECK_MEMORY(p.poses && p.seen && views && far->xyz && far->rgb, "%lld points", (long long)points->count);
  if (pags_dataset_sweep_count(dataset) > 0)
    p.time_begin = pags_dataset_sweep(dataset, 0)->time;
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++)
    if (!pags_dataset_view(dataset, i)->test)
      views[count++] = i;
  if (count == 0)
    return PAGS_OK;
  const pags_camera *first = &pags_dataset_view(dataset, views[0])->camera;
  const int side = first->width > first->height ? first->width : first->height;
  int shrink = 1;
  while (side / shrink > LONGEST_SIDE)
    shrink *= 2;
  pags_photo_cache_prefetch(photos, views, count, shrink);
  for (int64_t i = 0; i < count; i++) {
    PAGS_TRY(colorize_view(&p, photos, views[i], shrink));
    const int64_t share = far->wanted * (i + 1) / count - far->wanted * i / count;
    pags_far_draw(&p.photo, &p.camera, &p.z_buffer, pags_dataset_origin(dataset), (uint64_t)i, share, far);
  }
  return PAGS_OK;
}
