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
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { BLOCK = 4096, LONGEST_SIDE = 1200 };

static const float near_time = 0.5f;  /* seconds between photograph and measurement at which the weight is halved */
static const float doubtful = 1e-3f;  /* factor on the weight of a pixel that probably shows something else */
static const double near_plane = 0.1; /* metres */

/* Pose of the background or of a moving object (the owner of points) for the current photograph. */
typedef struct owner_pose {
  int present; /* 0: the object is not there at this time */
  float m[12]; /* camera from the owner's frame */
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

/* ---- Projection and weights ---- */

static void set_motion(const colorizer *p, const double world_from_owner[12], owner_pose *out) {
  double inverse[12], m[12];
  pags_rigid_inverse(p->camera.world_from_camera, inverse);
  pags_rigid_multiply(inverse, world_from_owner, m);
  for (int i = 0; i < 12; i++)
    out->m[i] = (float)m[i];
  out->present = 1;
}

/* Where a camera with a lens shows a point; its depth is the distance. */
static pags_seen_point see_through(const pags_camera *c, const float m[12], const float q[3]) {
  double own[3], at[2], square = 0;
  for (int k = 0; k < 3; k++) {
    own[k] = (double)(m[4 * k] * q[0] + m[4 * k + 1] * q[1] + m[4 * k + 2] * q[2] + m[4 * k + 3]);
    square += own[k] * own[k];
  }
  if (!(square > near_plane * near_plane) || !pags_camera_project(c, own, at, NULL))
    return (pags_seen_point){0};
  const float u = (float)at[0], v = (float)at[1];
  const bool inside = u >= 0 && v >= 0 && u < (float)c->width && v < (float)c->height;
  return inside ? (pags_seen_point){u, v, (float)sqrt(square)} : (pags_seen_point){0};
}

static void project_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
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

/* Weight of a photograph's pixel in the colour of a point; 0 if the pixel is masked out or the point is hidden.
 * Points of a grid, which need not lie on a surface, are coloured even where hidden, with the factor `doubtful`. */
static float weight_of(const colorizer *p, const pags_lidar_point *row, const pags_seen_point *at, int64_t pixel) {
  int visible = pags_z_buffer_visible(&p->z_buffer, at), labels = p->photo.labels ? p->photo.labels[pixel] : 0;
  if (p->photo.mask && !p->photo.mask[pixel])
    return 0;
  if (!visible && row->kind != PAGS_CANDIDATE_GRID)
    return 0;
  float apart = (row->time - (float)(p->camera.time - p->time_begin)) / near_time;
  float weight = 1 / (at->z * at->z);
  if (isfinite(apart))
    weight /= 1 + apart * apart;
  if (!visible || is_doubtful(p, row, labels))
    weight *= doubtful;
  return weight;
}

/* Counts the labelled views that show a point, and those of them whose pixel is labelled critical. The ratio of the
 * two becomes the initial s_sem. */
static void count_view(const colorizer *p, pags_lidar_point *row, const pags_seen_point *at, int64_t pixel) {
  if (!p->photo.labels || (p->photo.mask && !p->photo.mask[pixel]) || !pags_z_buffer_visible(&p->z_buffer, at))
    return;
  row->views[0] += 1;
  row->views[1] += (p->photo.labels[pixel] & PAGS_LABEL_CRITICAL) != 0;
}

/* ---- One photograph ---- */

static void colorize_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const colorizer *p = context;
  int64_t plane = (int64_t)p->photo.height * p->photo.stride;
  for (int64_t i = begin; i < end; i++) {
    const pags_seen_point *at = &p->seen[i];
    pags_lidar_point *row = &p->points->rows[i];
    if (!(at->z > 0))
      continue;
    int64_t pixel = (int64_t)at->v * p->photo.stride + (int64_t)at->u;
    float weight = weight_of(p, row, at, pixel);
    for (int c = 0; c < 3; c++)
      row->sum[c] += weight * (float)p->photo.rgb[c * plane + pixel];
    row->sum[3] += weight;
    count_view(p, row, at, pixel);
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
    p->poses[1 + i].present = 0;
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

static int shrink_of(const pags_camera *camera) {
  int side = camera->width > camera->height ? camera->width : camera->height, shrink = 1;
  while (side / shrink > LONGEST_SIDE)
    shrink *= 2;
  return shrink;
}

static pags_result colorize_all(colorizer *p, pags_photo_cache *photos, const int64_t *views, int64_t count,
                                pags_far_points *far) {
  int shrink = shrink_of(&pags_dataset_view(p->dataset, views[0])->camera);
  pags_photo_cache_prefetch(photos, views, count, shrink);
  for (int64_t i = 0; i < count; i++) {
    PAGS_TRY(colorize_view(p, photos, views[i], shrink));
    int64_t share = far->wanted * (i + 1) / count - far->wanted * i / count;
    pags_far_draw(&p->photo, &p->camera, &p->z_buffer, pags_dataset_origin(p->dataset), (uint64_t)i, share, far);
  }
  return PAGS_OK;
}

static pags_result allocate(colorizer *p, int64_t **views, pags_far_points *far) {
  size_t points = (size_t)(p->points->count > 0 ? p->points->count : 1);
  size_t wanted = (size_t)(far->wanted > 0 ? far->wanted : 1);
  p->poses = calloc((size_t)pags_dataset_object_count(p->dataset) + 1, sizeof *p->poses);
  p->seen = malloc(points * sizeof *p->seen);
  *views = malloc(((size_t)pags_dataset_view_count(p->dataset) + 1) * sizeof **views);
  far->count = 0;
  far->xyz = malloc(wanted * 3 * sizeof *far->xyz);
  far->rgb = malloc(wanted * 3);
  return p->poses && p->seen && *views && far->xyz && far->rgb
             ? PAGS_OK
             : pags_out_of_memory("%lld points", (long long)p->points->count);
}

pags_result pags_lidar_points_colorize(const pags_dataset *dataset, pags_tasks *tasks, pags_lidar_points *points,
                                       int64_t measured, pags_photo_cache *photos, pags_far_points *far) {
  colorizer p = {.dataset = dataset, .tasks = tasks, .points = points, .measured = measured};
  int64_t *views = NULL, count = 0;
  if (pags_dataset_sweep_count(dataset) > 0)
    p.time_begin = pags_dataset_sweep(dataset, 0)->time;
  pags_result result = allocate(&p, &views, far);
  for (int64_t i = 0; result == PAGS_OK && i < pags_dataset_view_count(dataset); i++)
    if (!pags_dataset_view(dataset, i)->test)
      views[count++] = i;
  if (result == PAGS_OK && count > 0)
    result = colorize_all(&p, photos, views, count, far);
  pags_z_buffer_destroy(&p.z_buffer);
  free(p.poses);
  free(p.seen);
  free(views);
  return result;
}
