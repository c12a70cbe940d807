/* SPDX-License-Identifier: Apache-2.0 */
/* Computes the camera paths of camera_paths.h: positions by Catmull-Rom splines, rotations by spherical
 * interpolation. World coordinates are absolute, in double. */
#include "cli/camera_paths.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "maths/maths.h"

typedef struct vec3 {
  double x, y, z;
} vec3;

static const double pi = 3.14159265358979323846;
enum { DEFAULT_WIDTH = 1280, DEFAULT_HEIGHT = 720, DEFAULT_FOCAL = 1000, MAX_SAMPLES = 100000, PATH_FPS = 30 };

/* ---- Vectors and poses ---- */

static vec3 add(vec3 a, vec3 b) {
  return (vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static vec3 scale(vec3 a, double s) {
  return (vec3){a.x * s, a.y * s, a.z * s};
}
static vec3 sub(vec3 a, vec3 b) {
  return (vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static double dot(vec3 a, vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
static double length(vec3 a) {
  return sqrt(dot(a, a));
}
static vec3 cross(vec3 a, vec3 b) {
  return (vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static vec3 normalized(vec3 a) {
  double l = length(a);
  return l > 0 ? scale(a, 1 / l) : a;
}

/* Returns column `c` of world_from_camera: 0 right, 1 down, 2 forward, 3 position. */
static vec3 column(const pags_camera *camera, int c) {
  const double *m = camera->world_from_camera;
  return (vec3){m[c], m[4 + c], m[8 + c]};
}

static void set_column(pags_camera *camera, int c, vec3 v) {
  double *m = camera->world_from_camera;
  m[c] = v.x;
  m[4 + c] = v.y;
  m[8 + c] = v.z;
}

/* Sorts `values` and returns their `share` quantile (share 0..1). */
static double percentile(double *values, int64_t count, double share) {
  pags_sort_doubles(values, count);
  return values[(int64_t)(share * (double)(count - 1) + 0.5)];
}

static pags_result create_path(int64_t frames, pags_camera_path *out) {
  *out = (pags_camera_path){.fps = PATH_FPS, .count = frames, .cameras = calloc((size_t)frames, sizeof *out->cameras)};
  if (!out->cameras)
    return pags_out_of_memory("a path of %lld frames", (long long)frames);
  return PAGS_OK;
}

static vec3 scene_up(const pags_scene *scene) {
  return scene->up == PAGS_UP_Z ? (vec3){0, 0, 1} : (vec3){0, -1, 0};
}

/* ---- Orbits ---- */

/* An orbit's geometry and lens. */
typedef struct orbit {
  vec3 centre, up;
  double radius, height;         /* horizontal distance of the eye from the centre, and its height above the centre */
  double middle_angle, half_arc; /* of the azimuths covered; half_arc = pi: a full turn */
  pags_camera lens;
} orbit;

/* Finds two axes u, v that span the plane perpendicular to `up`. */
static void horizontal_axes(vec3 up, vec3 *u, vec3 *v) {
  *u = normalized(cross(up, fabs(up.x) < 0.9 ? (vec3){1, 0, 0} : (vec3){0, 1, 0}));
  *v = cross(up, *u);
}

/* Solves the symmetric 3x3 system a x = b by Cramer's rule; returns false if the determinant is nearly 0 relative to
 * the trace. */
static bool solve3(const double a[6], vec3 b, vec3 *x) { /* a: xx xy xz yy yz zz */
  vec3 r0 = {a[0], a[1], a[2]}, r1 = {a[1], a[3], a[4]}, r2 = {a[2], a[4], a[5]};
  double determinant = dot(r0, cross(r1, r2)), trace = (a[0] + a[3] + a[5]) / 3;
  if (!(fabs(determinant) > 1e-4 * trace * trace * trace))
    return false;
  vec3 sum = add(add(scale(cross(r1, r2), b.x), scale(cross(r2, r0), b.y)), scale(cross(r0, r1), b.z));
  *x = scale(sum, 1 / determinant);
  return true;
}

/* Finds the point with the least sum of squared distances to the views' optical axes: sum (I - d d') (x - p) = 0.
 * Returns false if the axes are nearly parallel or the point isn't in front of most cameras. */
static bool nearest_to_axes(const pags_scene *scene, vec3 *out) {
  double a[6] = {0};
  vec3 b = {0, 0, 0}, base = column(&scene->views[0].camera, 3);
  int64_t ahead = 0;
  for (int64_t i = 0; i < scene->view_count; i++) {
    vec3 d = column(&scene->views[i].camera, 2), p = sub(column(&scene->views[i].camera, 3), base);
    double m[6] = {1 - d.x * d.x, -d.x * d.y, -d.x * d.z, 1 - d.y * d.y, -d.y * d.z, 1 - d.z * d.z};
    for (int k = 0; k < 6; k++)
      a[k] += m[k];
    b = add(b, sub(p, scale(d, dot(d, p))));
  }
  if (!solve3(a, b, out))
    return false;
  *out = add(*out, base);
  for (int64_t i = 0; i < scene->view_count; i++) {
    const pags_camera *camera = &scene->views[i].camera;
    ahead += dot(sub(*out, column(camera, 3)), column(camera, 2)) > 0;
  }
  /* for cameras that look outwards, the point nearest to their axes lies behind them */
  return ahead * 10 >= scene->view_count * 8;
}

/* Computes the median of the Gaussians' positions per axis (absolute), and half the diagonal of the box between their
 * 10th and 90th percentiles, in metres. */
static pags_result gaussian_middle(const pags_scene *scene, vec3 *centre, double *extent) {
  int64_t total = pags_scene_gaussian_count(scene), step = total / MAX_SAMPLES + 1;
  double middle[3], half[3],
      *values = malloc(((size_t)(total / step) + 1 + (size_t)scene->model_count) * sizeof *values);
  if (!values)
    return pags_out_of_memory(NULL);
  for (int axis = 0; axis < 3; axis++) {
    int64_t count = 0;
    for (int64_t m = 0; m < scene->model_count; m++) {
      const pags_gaussians *gaussians = &scene->models[m].gaussians;
      for (int64_t i = 0; i < gaussians->count; i += step)
        values[count++] = (double)pags_plane(gaussians, PAGS_MEAN + axis)[i];
    }
    if (!count) {
      free(values);
      return pags_fail(PAGS_ERROR_ARGUMENT, "an orbit needs at least one Gaussian or camera; the scene has none");
    }
    middle[axis] = percentile(values, count, 0.5) + scene->origin[axis];
    half[axis] = (values[(count - 1) * 9 / 10] - values[(count - 1) / 10]) / 2;
  }
  free(values);
  *centre = (vec3){middle[0], middle[1], middle[2]};
  *extent = fmax(sqrt(half[0] * half[0] + half[1] * half[1] + half[2] * half[2]), 1e-3);
  return PAGS_OK;
}

static pags_result orbit_of_gaussians(const pags_scene *scene, orbit *out) {
  double extent;
  PAGS_TRY(gaussian_middle(scene, &out->centre, &extent));
  out->up = scene_up(scene);
  out->radius = 3.2 * extent; /* at this distance the extent fits into the picture's height */
  out->height = 0.8 * extent;
  out->half_arc = pi;
  out->lens = (pags_camera){.width = DEFAULT_WIDTH,
                            .height = DEFAULT_HEIGHT,
                            .fx = DEFAULT_FOCAL,
                            .fy = DEFAULT_FOCAL,
                            .cx = DEFAULT_WIDTH / 2.0,
                            .cy = DEFAULT_HEIGHT / 2.0,
                            .time = (double)NAN};
  return PAGS_OK;
}

static pags_result orbit_of_views(const pags_scene *scene, orbit *out) {
  size_t count = (size_t)scene->view_count;
  double extent, *radii = malloc(3 * count * sizeof *radii), *heights = radii + count, *angles = heights + count;
  if (!radii)
    return pags_out_of_memory(NULL);
  pags_result result = PAGS_OK;
  if (!nearest_to_axes(scene, &out->centre))
    result = gaussian_middle(scene, &out->centre, &extent);

  /* Up is the mean of the cameras' up axes; the scene's up if these disagree. */
  vec3 sum = {0, 0, 0};
  for (int64_t i = 0; i < scene->view_count; i++)
    sum = sub(sum, column(&scene->views[i].camera, 1));
  out->up = length(sum) > 0.3 * (double)scene->view_count ? normalized(sum) : scene_up(scene);

  vec3 u, v;
  horizontal_axes(out->up, &u, &v);
  for (size_t i = 0; i < count; i++) {
    vec3 offset = sub(column(&scene->views[i].camera, 3), out->centre);
    heights[i] = dot(offset, out->up);
    radii[i] = pags_hypot(dot(offset, u), dot(offset, v));
    angles[i] = pags_atan2(dot(offset, v), dot(offset, u));
  }
  out->height = percentile(heights, scene->view_count, 0.5);
  out->radius = fmax(percentile(radii, scene->view_count, 0.5), 1e-3);

  /* The arc covered by the sorted azimuths is everything but the widest gap between two of them. */
  double *middle = &out->middle_angle;
  double *half_arc = &out->half_arc;
  pags_sort_doubles(angles, scene->view_count);
  double widest = angles[0] + 2 * pi - angles[scene->view_count - 1], start = angles[0];
  for (int64_t i = 1; i < scene->view_count; i++)
    if (angles[i] - angles[i - 1] > widest) {
      widest = angles[i] - angles[i - 1];
      start = angles[i];
    }
  *half_arc = widest < pi / 2 ? pi : (2 * pi - widest) / 2;
  *middle = start + (2 * pi - widest) / 2;

  out->lens = scene->views[0].camera;
  free(radii);
  return result;
}

/* Orbit for a drive, whose cameras look along a street and so have no common centre: circles, from above, a place
 * ahead of the mean camera position. */
static pags_result orbit_of_drive(const pags_scene *scene, orbit *out) {
  enum { AHEAD = 6, RADIUS = 14, HEIGHT = 9 }; /* metres; low enough to show the sides that the cameras saw */
  vec3 base = column(&scene->views[0].camera, 3), sum = {0, 0, 0};
  for (int64_t i = 0; i < scene->view_count; i++)
    sum =
        add(sum, add(sub(column(&scene->views[i].camera, 3), base), scale(column(&scene->views[i].camera, 2), AHEAD)));
  *out = (orbit){.centre = add(base, scale(sum, 1.0 / (double)scene->view_count)),
                 .up = scene_up(scene),
                 .radius = RADIUS,
                 .height = HEIGHT,
                 .half_arc = pi,
                 .lens = scene->views[0].camera};
  return PAGS_OK;
}

pags_result pags_camera_path_orbit(const pags_scene *scene, int64_t frames, pags_camera_path *out) {
  orbit around = {0};
  PAGS_TRY(pags_scene_is_drive(scene) ? orbit_of_drive(scene, &around)
           : scene->view_count > 1    ? orbit_of_views(scene, &around)
                                      : orbit_of_gaussians(scene, &around));
  PAGS_TRY(create_path(frames, out));
  vec3 u, v;
  horizontal_axes(around.up, &u, &v);
  for (int64_t i = 0; i < frames; i++) {
    double turn = 2 * pi * (double)i / (double)frames;
    bool full = around.half_arc >= pi;
    double angle = around.middle_angle + (full ? turn : around.half_arc * pags_sin(turn));
    vec3 across = add(scale(u, pags_cos(angle)), scale(v, pags_sin(angle)));
    vec3 eye = add(around.centre, add(scale(across, around.radius), scale(around.up, around.height)));
    out->cameras[i] = around.lens;

    /* Orient the camera from `eye` towards the centre, with its picture as upright as possible. */
    vec3 forward = normalized(sub(around.centre, eye)), right = cross(forward, around.up);
    if (length(right) < 1e-6) /* looking straight up or down: any right axis will do */
      right = cross(forward, fabs(forward.x) < 0.9 ? (vec3){1, 0, 0} : (vec3){0, 1, 0});
    right = normalized(right);
    set_column(&out->cameras[i], 0, right);
    set_column(&out->cameras[i], 1, cross(forward, right));
    set_column(&out->cameras[i], 2, forward);
    set_column(&out->cameras[i], 3, eye);
  }
  return PAGS_OK;
}

/* ---- Flights through the training views ---- */

static double catmull_rom(double a, double b, double c, double d, double t) {
  return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

static vec3 catmull_rom3(vec3 a, vec3 b, vec3 c, vec3 d, double t) {
  return (vec3){catmull_rom(a.x, b.x, c.x, d.x, t), catmull_rom(a.y, b.y, c.y, d.y, t),
                catmull_rom(a.z, b.z, c.z, d.z, t)};
}

/* Spherical linear interpolation of unit quaternions along the shorter arc (Shoemake 1985). */
static void slerp(const double a[4], const double b[4], double t, double out[4]) {
  double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], sign = cosine < 0 ? -1 : 1;
  double angle = pags_acos(fmin(1, fabs(cosine))), sine = pags_sin(angle);
  double wa = sine > 1e-9 ? pags_sin((1 - t) * angle) / sine : 1 - t, wb = sine > 1e-9 ? pags_sin(t * angle) / sine : t;
  for (int i = 0; i < 4; i++)
    out[i] = wa * a[i] + sign * wb * b[i];
}

/* Interpolates a camera at parameter t (0..1) between knots[1] and knots[2]; knots[0] and knots[3] shape the position
 * spline. Picture size and intrinsics are those of `lens`. */
static pags_camera between(const pags_camera *const knots[4], const pags_camera *lens, double t) {
  pags_camera camera = *lens;
  const pags_camera *a = knots[1], *b = knots[2];
  double ra[9], rb[9], r[9], qa[4], qb[4], q[4];
  for (int row = 0; row < 3; row++)
    for (int c = 0; c < 3; c++) {
      ra[3 * row + c] = a->world_from_camera[4 * row + c];
      rb[3 * row + c] = b->world_from_camera[4 * row + c];
    }
  pags_quaternion_from_rotation(ra, qa);
  pags_quaternion_from_rotation(rb, qb);
  slerp(qa, qb, t, q);
  pags_rotation_from_quaternion(q, r);
  for (int c = 0; c < 3; c++)
    set_column(&camera, c, (vec3){r[c], r[3 + c], r[6 + c]});
  set_column(&camera, 3, catmull_rom3(column(knots[0], 3), column(a, 3), column(b, 3), column(knots[3], 3), t));
  camera.time = a->time + t * (b->time - a->time);
  return camera;
}

pags_result pags_camera_path_views(const pags_scene *scene, pags_camera_path *out) {
  *out = (pags_camera_path){.cameras = malloc((size_t)(scene->view_count + 1) * sizeof *out->cameras)};
  if (!out->cameras)
    return pags_out_of_memory("%lld cameras", (long long)scene->view_count);
  for (int64_t i = 0; i < scene->view_count; i++)
    if (!scene->views[i].test)
      out->cameras[out->count++] = scene->views[i].camera;
  return PAGS_OK;
}

pags_result pags_camera_path_ego(const pags_scene *scene, int64_t frames, pags_camera_path *out) {
  size_t views = (size_t)scene->view_count;
  const pags_camera **knots = calloc(views + 1, sizeof *knots);
  double *reached = calloc(views + 1, sizeof *reached); /* path length up to each knot, metres */
  int64_t count = 0;
  pags_result result = knots && reached ? PAGS_OK : pags_out_of_memory(NULL);
  for (size_t i = 0; result == PAGS_OK && i < views; i++)
    if (!scene->views[i].test)
      knots[count++] = &scene->views[i].camera;
  if (result == PAGS_OK && count < 2)
    result = pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 training views; the scene has %lld",
                       (long long)count);
  if (result == PAGS_OK)
    result = create_path(frames, out);
  for (int64_t i = 1; result == PAGS_OK && i < count; i++)
    reached[i] = reached[i - 1] + fmax(length(sub(column(knots[i], 3), column(knots[i - 1], 3))), 1e-9);
  int64_t knot = 0;
  for (int64_t i = 0; result == PAGS_OK && i < frames; i++) {
    double at = frames > 1 ? reached[count - 1] * (double)i / (double)(frames - 1) : 0;
    while (knot + 2 < count && reached[knot + 1] < at)
      knot++;
    const pags_camera *around[4] = {knots[knot > 0 ? knot - 1 : 0], knots[knot], knots[knot + 1],
                                    knots[knot + 2 < count ? knot + 2 : knot + 1]};
    double t = (at - reached[knot]) / (reached[knot + 1] - reached[knot]);
    out->cameras[i] = between(around, knots[0], fmin(fmax(t, 0), 1));
  }
  free(knots);
  free(reached);
  return result;
}

/* ---- Drives ---- */

static bool is_recorded(const pags_scene_view *view) {
  return view->sensor >= 0 && isfinite(view->camera.time);
}

bool pags_scene_is_drive(const pags_scene *scene) {
  for (int64_t i = 0; i < scene->view_count; i++)
    if (is_recorded(&scene->views[i]))
      return true;
  return false;
}

static int compare_times(const void *a, const void *b) {
  const pags_camera *const *x = a;
  const pags_camera *const *y = b;
  return ((*x)->time > (*y)->time) - ((*x)->time < (*y)->time);
}

int pags_camera_path_drive_sensor(const pags_scene *scene) {
  int sensor = -1;
  for (int64_t i = 0; i < scene->view_count; i++)
    if (is_recorded(&scene->views[i]) && (sensor < 0 || scene->views[i].sensor < sensor))
      sensor = scene->views[i].sensor;
  return sensor;
}

/* Lists the cameras of the sensor with the lowest number in order of time, without repeated times; returns how
 * many. */
static int64_t first_sensor(const pags_scene *scene, const pags_camera **knots) {
  int64_t count = 0, kept = 0;
  const int sensor = pags_camera_path_drive_sensor(scene);
  for (int64_t i = 0; i < scene->view_count; i++)
    if (is_recorded(&scene->views[i]) && scene->views[i].sensor == sensor)
      knots[count++] = &scene->views[i].camera;
  pags_sort(knots, count, sizeof *knots, compare_times);
  for (int64_t i = 0; i < count; i++)
    if (kept == 0 || knots[i]->time > knots[kept - 1]->time)
      knots[kept++] = knots[i];
  return kept;
}

/* Interpolates the camera at `time`, which lies between the first and the last of `knots`. *knot is the index of the
 * knot before it; calls must be in order of time, since it only grows. */
static pags_camera driven(const pags_camera *const *knots, int64_t count, double time, int64_t *knot) {
  while (*knot + 2 < count && knots[*knot + 1]->time <= time)
    ++*knot;
  const pags_camera *a = knots[*knot], *b = knots[*knot + 1];
  const pags_camera *around[4] = {knots[*knot > 0 ? *knot - 1 : 0], a, b,
                                  knots[*knot + 2 < count ? *knot + 2 : *knot + 1]};
  pags_camera camera = between(around, knots[0], fmin(fmax((time - a->time) / (b->time - a->time), 0), 1));
  camera.time = time;
  return camera;
}

static pags_result drive(const pags_camera *const *knots, int64_t count, int64_t frames, double fps,
                         pags_camera_path *out) {
  if (count < 2)
    return pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 views of the first sensor; the scene has %lld",
                     (long long)count);
  double begin = knots[0]->time, span = knots[count - 1]->time - begin, even = span * fps;
  bool recorded = frames == 0 && fps == 0;
  if (even > 1e6)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--fps: %g frames a second for %g s are more than a million", fps, span);
  int64_t total = frames ? frames : recorded ? count : (int64_t)(even + 1e-6) + 1;
  PAGS_TRY(create_path(total, out));
  int64_t knot = 0;
  for (int64_t i = 0; i < total; i++) {
    double share = total > 1 ? (double)i / (double)(total - 1) : 0;
    double time = recorded ? knots[i]->time : frames ? begin + share * span : begin + (double)i / fps;
    out->cameras[i] = driven(knots, count, fmin(time, begin + span), &knot);
  }
  return PAGS_OK;
}

pags_result pags_camera_path_drive(const pags_scene *scene, int64_t frames, double fps, pags_camera_path *out) {
  const pags_camera **knots = calloc((size_t)scene->view_count + 1, sizeof *knots);
  if (!knots)
    return pags_out_of_memory(NULL);
  pags_result result = drive(knots, first_sensor(scene, knots), frames, fps, out);
  free(knots);
  return result;
}

void pags_camera_path_shift(pags_camera_path *path, double metres) {
  for (int64_t i = 0; i < path->count; i++) {
    pags_camera *camera = &path->cameras[i];
    set_column(camera, 3, add(column(camera, 3), scale(column(camera, 0), metres)));
  }
}
