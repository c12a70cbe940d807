/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the initial points of a driving scene.
 *
 * Yan et al. (Street Gaussians, 2024) start from LiDAR points that are coloured by projection and split by the
 * objects' boxes, the background's in voxels of 0.15 m, and from structure from motion; surfaces that the LiDAR never
 * reaches are covered by random points, as drivestudio does it. Here, unlike there, the voxels grow with the distance
 * and with the number of points, colours are means over all photographs that show a point, and points that no
 * training photograph shows are left out. */
#include "init/driving_points.h"

#include <math.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "init/colorize.h"

enum {
  MOST_READ = 3000000,   /* background points read from the sweeps */
  MOST_PAINTED = 600000, /* background points that are coloured */
  MOST_OBJECT = 20000,   /* points of each object (Street Gaussians) */
  FEW_OBJECT = 2000,     /* with fewer, an object gets mirrored points, too (Street Gaussians) */
  LEAST_OBJECT = 500,    /* with fewer still, a grid of points in its box, too */
  FAR_POINTS = 40000,    /* random points where there is no LiDAR */
  MATCHED_POINTS = 40000 /* points matched between photographs, without LiDAR and structure from motion */
};

static const double finest_voxel = 0.05, voxel_step = 1.25; /* smallest side, metres; factor of growth */
static const double farthest_times = 4.0;                   /* depth of random points, in radii of the scene */

static void free_set(pags_point_set *set) {
  free(set->xyz);
  free(set->rgb);
  free(set->object);
  free(set->s_sem);
}

void pags_driving_points_destroy(pags_driving_points *start) {
  for (int64_t i = 0; i < start->object_count; i++)
    free_set(&start->objects[i]);
  free(start->objects);
  free_set(&start->background);
  *start = (pags_driving_points){0};
}

static pags_result reserve(pags_point_set *points, int64_t count, bool background) {
  const size_t room = (size_t)(count > 0 ? count : 1);
  points->xyz = malloc(room * 3 * sizeof *points->xyz);
  points->rgb = malloc(room * 3);
  points->object = background ? malloc(room * sizeof *points->object) : NULL;
  points->s_sem = background ? calloc(room, sizeof *points->s_sem) : NULL;
  PAGS_CHECK_MEMORY(points->xyz && points->rgb && ((points->object && points->s_sem) || !background), "%lld points",
                    (long long)count);
  return PAGS_OK;
}

static void put(pags_point_set *to, const float *xyz, const uint8_t *rgb, int32_t object) {
  pags_copy3f(xyz, to->xyz + 3 * to->count);
  memcpy(to->rgb + 3 * to->count, rgb, 3);
  if (to->object)
    to->object[to->count] = object;
  to->count++;
}

static void colour_of(const pags_lidar_point *row, uint8_t rgb[3]) {
  for (int c = 0; c < 3; c++)
    rgb[c] = (uint8_t)fminf(255.0f, row->sum[c] / row->sum[3] + 0.5f);
}

/* ---- Points of objects ---- */

/* Takes the points of one owner and kind, from row `from` on, that a photograph gave a colour. A mirrored point without
 * a colour takes that of the measured point it mirrors. */
static int64_t take_kind(const pags_lidar_points *points, int32_t owner, int kind, int64_t from, pags_point_set *to) {
  for (int64_t i = from; i < points->count; i++) {
    const pags_lidar_point *row = &points->rows[i], *coloured = row;
    uint8_t rgb[3];
    if (row->owner != owner || row->kind != kind)
      continue;
    if (kind == PAGS_CANDIDATE_MIRRORED && !(row->sum[3] > 0))
      coloured = &points->rows[row->source];
    if (!(coloured->sum[3] > 0))
      continue;
    colour_of(coloured, rgb);
    put(to, row->p, rgb, 0);
  }
  return to->count;
}

static pags_result take_object(const pags_lidar_points *points, int32_t owner, int64_t measured, pags_point_set *to) {
  int64_t all = 0;
  for (int64_t i = 0; i < points->count; i++)
    all += points->rows[i].owner == owner;
  if (all == 0)
    return PAGS_OK;
  PAGS_TRY(reserve(to, all, false));
  int64_t count = take_kind(points, owner, PAGS_CANDIDATE_MEASURED, 0, to);
  if (count < FEW_OBJECT)
    count = take_kind(points, owner, PAGS_CANDIDATE_MIRRORED, measured, to);
  if (count < LEAST_OBJECT)
    take_kind(points, owner, PAGS_CANDIDATE_GRID, measured, to);
  return PAGS_OK;
}

/* ---- Points of the background ---- */

/* Merges the background's points by voxels until at most `most` are left. The voxels' side starts at *side and grows
 * by the factor voxel_step; *side receives the final one. */
static pags_result thin_background(pags_lidar_points *points, pags_tasks *tasks, const float *eyes, int64_t eye_count,
                                   int64_t most, double *side) {
  for (;; *side *= voxel_step) {
    PAGS_TRY(pags_lidar_points_merge(points, tasks, eyes, eye_count, *side));
    int64_t left = 0;
    for (int64_t i = 0; i < points->count; i++)
      left += points->rows[i].owner < 0;
    if (left <= most)
      return PAGS_OK;
  }
}

static double distance_from(const float *p, const double middle[3]) {
  double wide[3];
  pags_widen3(p, wide);
  return pags_distance3(wide, middle);
}

/* Radius, metres, of the sphere about `middle`, the cameras' mean position, that holds 95 % of the background's
 * points: at least 30 m, 100 m without points. `largest` is the radius that holds all of them, infinity without
 * points. */
static pags_result scene_radius(const pags_lidar_points *points, const double middle[3], double *radius,
                                double *largest) {
  PAGS_AUTOFREE double *all = malloc((size_t)(points->count > 0 ? points->count : 1) * sizeof *all);
  PAGS_CHECK_MEMORY(all, "%lld points", (long long)points->count);
  int64_t count = 0;
  for (int64_t i = 0; i < points->count; i++)
    if (points->rows[i].owner < 0)
      all[count++] = distance_from(points->rows[i].p, middle);
  pags_sort_doubles(all, count);
  *radius = count ? fmax(30.0, all[count * 95 / 100]) : 100.0;
  *largest = count ? all[count - 1] : INFINITY;
  return PAGS_OK;
}

/* Does a point lie in a moving object's box at any time? Points of structure from motion carry no time, so all of
 * those are kept out of the background. */
static bool swept_by_object(const pags_dataset *dataset, const float *p) {
  const double *origin = pags_dataset_origin(dataset);
  double world[3], inverse[12], local[3];
  pags_widen3(p, world);
  pags_add3(world, origin, world);
  for (int64_t i = 0; i < pags_dataset_object_count(dataset); i++) {
    const pags_object *object = pags_dataset_object(dataset, i);
    for (int64_t n = 0; object->moving && n < object->keyframe_count; n++) {
      pags_rigid_inverse(object->keyframes[n].world_from_object, inverse);
      pags_rigid_point(inverse, world, local);
      if (fabs(local[0]) <= 0.5 * object->size[0] && fabs(local[1]) <= 0.5 * object->size[1] &&
          fabs(local[2]) <= 0.5 * object->size[2])
        return true;
    }
  }
  return false;
}

/* The points that do not come from LiDAR. */
typedef struct extra_points {
  int64_t count;
  const float *xyz;
  const uint8_t *rgb;
  float *matched_xyz; /* owned; both NULL for points of the data set */
  uint8_t *matched_rgb;
} extra_points;

/* Finds the points of structure from motion, or, if the data set has neither those nor LiDAR, matches points between
 * photographs. */
static pags_result find_extra(const pags_dataset *dataset, const pags_train_config *config, int64_t lidar,
                              pags_tasks *tasks, extra_points *out) {
  int to_match;
  *out = (extra_points){0};
  pags_dataset_points(dataset, &out->count, &out->xyz, &out->rgb, &to_match);
  if (out->count > 0 || lidar > 0)
    return PAGS_OK;
  out->count = MATCHED_POINTS;
  PAGS_TRY(pags_dataset_match_points(dataset, tasks, out->count, config->schedule.seed, &out->matched_xyz,
                                     &out->matched_rgb));
  out->xyz = out->matched_xyz;
  out->rgb = out->matched_rgb;
  return PAGS_OK;
}

/* ---- Putting all points together ---- */

typedef struct work {
  pags_lidar_points points;
  pags_far_points far;
  extra_points extra;
  float *eyes;
  int64_t eye_count;
} work;

static void free_work(work *w) {
  pags_lidar_points_destroy(&w->points);
  free(w->far.xyz);
  free(w->far.rgb);
  free(w->extra.matched_xyz);
  free(w->extra.matched_rgb);
  free(w->eyes);
}

/* Gathers, thins and colours the LiDAR points, of the background at most `most`. Leaves the background's points that a
 * photograph shows in w->points, and puts those of the objects into `out`. */
static pags_result make_lidar(const pags_dataset *dataset, int lidar, int most, pags_photo_cache *photos,
                              pags_tasks *tasks, work *w, double middle[3], double *largest, pags_driving_points *out) {
  double radius = 0, side = finest_voxel;
  if (lidar)
    PAGS_TRY(pags_lidar_points_gather(dataset, tasks, MOST_READ, &w->points));
  PAGS_TRY(pags_lidar_points_remove_rig(&w->points, tasks, w->eyes, w->eye_count));
  PAGS_TRY(thin_background(&w->points, tasks, w->eyes, w->eye_count, MOST_PAINTED, &side));
  PAGS_TRY(scene_radius(&w->points, middle, &radius, largest));
  PAGS_TRY(pags_lidar_points_complete(dataset, MOST_OBJECT, FEW_OBJECT, &w->points));
  int64_t measured = 0;
  while (measured < w->points.count && w->points.rows[measured].kind == PAGS_CANDIDATE_MEASURED)
    measured++;
  w->far.farthest = farthest_times * radius;
  PAGS_TRY(pags_lidar_points_colorize(dataset, tasks, &w->points, measured, photos, &w->far));

  /* The coloured points of the moving objects. */
  for (int64_t i = 0; i < out->object_count; i++)
    if (pags_dataset_object(dataset, i)->moving)
      PAGS_TRY(take_object(&w->points, (int32_t)i, measured, &out->objects[i]));

  /* Of the background, keep the points that got a colour. */
  int64_t kept = 0;
  for (int64_t i = 0; i < w->points.count; i++)
    if (w->points.rows[i].owner < 0 && w->points.rows[i].sum[3] > 0)
      w->points.rows[kept++] = w->points.rows[i];
  w->points.count = kept;

  PAGS_TRY(pags_lidar_points_remove_outliers(&w->points, tasks, w->eyes, w->eye_count));
  PAGS_TRY(thin_background(&w->points, tasks, w->eyes, w->eye_count, most, &side));
  pags_log_message(PAGS_LOG_INFO, "%s: %lld points of the background from LiDAR in voxels of %.3f m and more",
                   pags_dataset_path(dataset), (long long)w->points.count, side);
  return PAGS_OK;
}

pags_result pags_driving_points_create(const pags_dataset *dataset, const pags_train_config *config, int lidar,
                                       pags_photo_cache *photos, pags_tasks *tasks, pags_driving_points *out) {
  PAGS_AUTO(free_work) work w = {.far = {.wanted = FAR_POINTS, .seed = config->schedule.seed}};
  PAGS_AUTO(pags_driving_points_destroy)
  pags_driving_points made = {.object_count = pags_dataset_object_count(dataset)};
  double middle[3] = {0, 0, 0}, largest = INFINITY;
  *out = (pags_driving_points){0};
  made.objects = calloc((size_t)made.object_count + 1, sizeof *made.objects);
  PAGS_CHECK_MEMORY(made.objects, "%lld objects", (long long)made.object_count);

  /* The eyes: positions of the training cameras, relative to the data set's origin; and their mean. */
  w.eyes = malloc(((size_t)pags_dataset_view_count(dataset) + 1) * 3 * sizeof *w.eyes);
  PAGS_CHECK_MEMORY(w.eyes, "the cameras");
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    double eye[3];
    pags_pose_position(view->camera.world_from_camera, eye);
    pags_subtract3(eye, pags_dataset_origin(dataset), eye);
    if (!view->test)
      pags_narrow3(eye, w.eyes + 3 * w.eye_count++);
  }
  for (int64_t i = 0; i < w.eye_count; i++)
    for (int k = 0; k < 3; k++)
      middle[k] += (double)w.eyes[3 * i + k] / (double)w.eye_count;

  PAGS_TRY(make_lidar(dataset, lidar, config->start.lidar_points, photos, tasks, &w, middle, &largest, &made));
  PAGS_TRY(find_extra(dataset, config, w.points.count, tasks, &w.extra));

  /* The background's points in order: LiDAR, other points, random far points. */
  pags_point_set *to = &made.background;
  PAGS_TRY(reserve(to, w.points.count + w.extra.count + w.far.count, true));
  for (int64_t i = 0; i < w.points.count; i++) {
    uint8_t rgb[3];
    const pags_lidar_point *row = &w.points.rows[i];
    colour_of(row, rgb);
    to->s_sem[to->count] = row->views[0] > 0 ? row->views[1] / row->views[0] : 0.0f;
    put(to, row->p, rgb, row->parked);
  }
  made.lidar_points = to->count;
  for (int64_t i = 0; i < w.extra.count; i++)
    if (distance_from(w.extra.xyz + 3 * i, middle) <= 2 * largest && !swept_by_object(dataset, w.extra.xyz + 3 * i))
      put(to, w.extra.xyz + 3 * i, w.extra.rgb + 3 * i, -1);
  for (int64_t i = 0; i < w.far.count; i++)
    put(to, w.far.xyz + 3 * i, w.far.rgb + 3 * i, -1);
  *out = made;
  made = (pags_driving_points){0};
  return PAGS_OK;
}
