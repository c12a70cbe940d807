/* SPDX-License-Identifier: Apache-2.0 */
/* Colours for points.
 *
 * Every training photograph is looked at once, in order; within it every point finds out by itself whether it is seen
 * and what it looks like there. A point's colour is the mean over the photographs that see it, near ones counting more
 * (finer pixels), and those taken near the time of its measurement more than others (shadows move, labelled boxes
 * wander). What lies on pixels of something that moves, or of sky, counts only if there is nothing better. */
#include "init/colorize.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { BLOCK = 4096, LONGEST_SIDE = 1200 };

static const uint64_t cache_bytes = (uint64_t)128 << 20;
static const float near_time = 0.5f;  /* seconds: half the weight */
static const float doubtful = 1e-3f;  /* weight of a pixel that probably shows something else */
static const double near_plane = 0.1; /* metres */

typedef struct owner_pose {
  int present;
  float m[12]; /* camera from the owner's frame */
} owner_pose;

typedef struct colorizer {
  const pags_dataset *dataset;
  pags_tasks *tasks;
  pags_lidar_points *points;
  int64_t measured;
  double time_begin;
  owner_pose *poses; /* 1 + objects; the background's first */
  pags_seen_point *seen;
  pags_z_buffer z_buffer;
  pags_photo photo;
  pags_camera camera;
} colorizer;

static void set_motion(const colorizer *p, const double world_from_owner[12], owner_pose *out) {
  double inverse[12], m[12];
  pags_rigid_inverse(p->camera.world_from_camera, inverse);
  pags_rigid_multiply(inverse, world_from_owner, m);
  for (int i = 0; i < 12; i++)
    out->m[i] = (float)m[i];
  out->present = 1;
}

static void project_block(void *context, int64_t begin, int64_t end, int worker) {
  (void)worker;
  const colorizer *p = context;
  const pags_camera *c = &p->camera;
  const float fx = (float)c->fx, fy = (float)c->fy, cx = (float)c->cx, cy = (float)c->cy;
  for (int64_t i = begin; i < end; i++) {
    const pags_lidar_point *row = &p->points->rows[i];
    const owner_pose *pose = &p->poses[1 + row->owner];
    const float *m = pose->m, *q = row->p;
    p->seen[i].z = 0;
    if (!pose->present)
      continue;
    float z = m[8] * q[0] + m[9] * q[1] + m[10] * q[2] + m[11];
    if (!(z > (float)near_plane))
      continue;
    float u = fx * (m[0] * q[0] + m[1] * q[1] + m[2] * q[2] + m[3]) / z + cx;
    float v = fy * (m[4] * q[0] + m[5] * q[1] + m[6] * q[2] + m[7]) / z + cy;
    if (u >= 0 && v >= 0 && u < (float)c->width && v < (float)c->height)
      p->seen[i] = (pags_seen_point){u, v, z};
  }
}

/* Does a pixel of these labels show something else? Boxes of several kinds may overlap there: then nobody knows. */
static int is_doubtful(const colorizer *p, const pags_lidar_point *row, int labels) {
  static const int bits[] = {[PAGS_CATEGORY_VEHICLE] = PAGS_LABEL_VEHICLE,
                             [PAGS_CATEGORY_PEDESTRIAN] = PAGS_LABEL_PEDESTRIAN,
                             [PAGS_CATEGORY_CYCLIST] = PAGS_LABEL_CYCLIST};
  const int boxes = PAGS_LABEL_VEHICLE | PAGS_LABEL_PEDESTRIAN | PAGS_LABEL_CYCLIST;
  if (row->owner < 0)
    return (labels & (boxes | PAGS_LABEL_MOVING | PAGS_LABEL_SKY)) != 0;
  int own = bits[pags_dataset_object(p->dataset, row->owner)->category];
  return (labels & (boxes | PAGS_LABEL_SKY)) != own && p->photo.labels;
}

/* 0: the pixel can't be used. */
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

/* The share of the views that show a point in which something critical is there: S_sem to begin with. */
static void count_view(const colorizer *p, pags_lidar_point *row, const pags_seen_point *at, int64_t pixel) {
  if (!p->photo.labels || (p->photo.mask && !p->photo.mask[pixel]) || !pags_z_buffer_visible(&p->z_buffer, at))
    return;
  row->views[0] += 1;
  row->views[1] += (p->photo.labels[pixel] & PAGS_LABEL_CRITICAL) != 0;
}

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

  /* Set poses. */
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
                                       int64_t measured, pags_far_points *far) {
  colorizer p = {.dataset = dataset, .tasks = tasks, .points = points, .measured = measured};
  pags_photo_cache *photos = NULL;
  int64_t *views = NULL, count = 0;
  if (pags_dataset_sweep_count(dataset) > 0)
    p.time_begin = pags_dataset_sweep(dataset, 0)->time;
  pags_result result = allocate(&p, &views, far);
  for (int64_t i = 0; result == PAGS_OK && i < pags_dataset_view_count(dataset); i++)
    if (!pags_dataset_view(dataset, i)->test)
      views[count++] = i;
  if (result == PAGS_OK && count > 0)
    result = pags_photo_cache_create(dataset, tasks, cache_bytes, &photos);
  if (result == PAGS_OK && count > 0)
    result = colorize_all(&p, photos, views, count, far);
  if (photos)
    pags_photo_cache_destroy(photos);
  pags_z_buffer_destroy(&p.z_buffer);
  free(p.poses);
  free(p.seen);
  free(views);
  return result;
}
