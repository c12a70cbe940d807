/* SPDX-License-Identifier: Apache-2.0 */
/* Computes the camera paths of camera_paths.h: positions by Catmull-Rom splines, rotations by spherical
 * interpolation; orbits are in orbit.c. World coordinates are absolute, in double. */
#include "cli/draw/camera_paths.h"

#include <math.h>
#include "base/memory.h"
#include "base/sort.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { PATH_FPS = 30 };

pags_result pags_camera_path_create(int64_t frames, pags_camera_path *out) {
  *out = (pags_camera_path){.fps = PATH_FPS, .count = frames, .cameras = calloc((size_t)frames, sizeof *out->cameras)};
  PAGS_CHECK_MEMORY(out->cameras, "a path of %lld frames", (long long)frames);
  return PAGS_OK;
}

/* ---- Flights through the training views ---- */

static double catmull_rom(double a, double b, double c, double d, double t) {
  return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

/* Spherical linear interpolation of unit quaternions along the shorter arc (Shoemake 1985). */
static void slerp(const double a[4], const double b[4], double t, double out[4]) {
  double cosine = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3], sign = cosine < 0 ? -1 : 1;
  double angle = pags_acos(fmin(1, fabs(cosine))), sine = pags_sin(angle);
  double wa = sine > 1e-9 ? pags_sin((1 - t) * angle) / sine : 1 - t, wb = sine > 1e-9 ? pags_sin(t * angle) / sine : t;
  for (int i = 0; i < 4; i++)
    out[i] = wa * a[i] + sign * wb * b[i];
}

/* Interpolates a camera between keyframes[at] and the next one at parameter t, clamped to 0..1; the positions' spline
 * is shaped by a keyframe more on either side. Picture size and intrinsics are those of the first keyframe. */
static pags_camera between(const pags_camera *const *keyframes, int64_t count, int64_t at, double t) {
  const pags_camera *a = keyframes[at], *b = keyframes[at + 1];
  pags_camera camera = *keyframes[0];
  double ra[9], rb[9], r[9], p[3], qa[4], qb[4], q[4];
  t = fmin(fmax(t, 0), 1);
  pags_pose_rotation(a->world_from_camera, ra);
  pags_pose_rotation(b->world_from_camera, rb);
  pags_quaternion_from_rotation(ra, qa);
  pags_quaternion_from_rotation(rb, qb);
  slerp(qa, qb, t, q);
  pags_rotation_from_quaternion(q, r);
  const double *const before = keyframes[at > 0 ? at - 1 : 0]->world_from_camera;
  const double *const behind = keyframes[at + 2 < count ? at + 2 : at + 1]->world_from_camera;
  for (int k = 0; k < 3; k++)
    p[k] = catmull_rom(before[4 * k + 3], a->world_from_camera[4 * k + 3], b->world_from_camera[4 * k + 3],
                       behind[4 * k + 3], t);
  pags_pose_make(r, p, camera.world_from_camera);
  camera.time = a->time + t * (b->time - a->time);
  return camera;
}

pags_result pags_camera_path_views(const pags_scene *scene, pags_camera_path *out) {
  *out = (pags_camera_path){.cameras = malloc((size_t)(scene->view_count + 1) * sizeof *out->cameras)};
  PAGS_CHECK_MEMORY(out->cameras, "%lld cameras", (long long)scene->view_count);
  for (int64_t i = 0; i < scene->view_count; i++)
    if (!scene->views[i].test)
      out->cameras[out->count++] = scene->views[i].camera;
  return PAGS_OK;
}

pags_result pags_camera_path_ego(const pags_scene *scene, int64_t frames, pags_camera_path *out) {
  const size_t views = (size_t)scene->view_count;
  PAGS_AUTOFREE const pags_camera **keyframes = calloc(views + 1, sizeof *keyframes);
  PAGS_AUTOFREE double *reached = calloc(views + 1, sizeof *reached); /* path length up to each keyframe, metres */
  int64_t count = 0, at = 0;
  PAGS_CHECK_MEMORY(keyframes && reached, NULL);
  for (size_t i = 0; i < views; i++)
    if (!scene->views[i].test)
      keyframes[count++] = &scene->views[i].camera;
  if (count < 2)
    return pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 training views; the scene has %lld",
                     (long long)count);
  PAGS_TRY(pags_camera_path_create(frames, out));
  for (int64_t i = 1; i < count; i++)
    reached[i] = reached[i - 1] +
                 fmax(pags_pose_distance(keyframes[i]->world_from_camera, keyframes[i - 1]->world_from_camera), 1e-9);
  for (int64_t i = 0; i < frames; i++) {
    const double way = frames > 1 ? reached[count - 1] * (double)i / (double)(frames - 1) : 0;
    while (at + 2 < count && reached[at + 1] < way)
      at++;
    out->cameras[i] = between(keyframes, count, at, (way - reached[at]) / (reached[at + 1] - reached[at]));
  }
  return PAGS_OK;
}

/* ---- Drives ---- */

static bool is_recorded(const pags_scene_view *view) {
  return view->sensor >= 0 && isfinite(view->camera.time);
}

bool pags_scene_is_drive(const pags_scene *scene) {
  return pags_camera_path_drive_sensor(scene) >= 0;
}

static int compare_times(const void *a, const void *b) {
  const pags_camera *const *x = a, *const *y = b;
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
static int64_t first_sensor(const pags_scene *scene, const pags_camera **keyframes) {
  int64_t count = 0, kept = 0;
  const int sensor = pags_camera_path_drive_sensor(scene);
  for (int64_t i = 0; i < scene->view_count; i++)
    if (is_recorded(&scene->views[i]) && scene->views[i].sensor == sensor)
      keyframes[count++] = &scene->views[i].camera;
  pags_sort(keyframes, count, sizeof *keyframes, compare_times);
  for (int64_t i = 0; i < count; i++)
    if (kept == 0 || keyframes[i]->time > keyframes[kept - 1]->time)
      keyframes[kept++] = keyframes[i];
  return kept;
}

pags_result pags_camera_path_drive(const pags_scene *scene, int64_t frames, double fps, pags_camera_path *out) {
  PAGS_AUTOFREE const pags_camera **keyframes = calloc((size_t)scene->view_count + 1, sizeof *keyframes);
  PAGS_CHECK_MEMORY(keyframes, NULL);
  const int64_t count = first_sensor(scene, keyframes);
  if (count < 2)
    return pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 views of the first sensor; the scene has %lld",
                     (long long)count);
  const double begin = keyframes[0]->time, span = keyframes[count - 1]->time - begin, even = span * fps;
  const bool recorded = frames == 0 && fps == 0;
  if (even > 1e6)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--fps: %g frames/s for %g s are more than a million frames", fps, span);
  const int64_t total = frames ? frames : recorded ? count : (int64_t)(even + 1e-6) + 1;
  PAGS_TRY(pags_camera_path_create(total, out));
  for (int64_t i = 0, at = 0; i < total; i++) {
    const double share = total > 1 ? (double)i / (double)(total - 1) : 0;
    const double wanted = recorded ? keyframes[i]->time : frames ? begin + share * span : begin + (double)i / fps;
    const double time = fmin(wanted, begin + span);
    while (at + 2 < count && keyframes[at + 1]->time <= time)
      at++;
    const double from = keyframes[at]->time;
    out->cameras[i] = between(keyframes, count, at, (time - from) / (keyframes[at + 1]->time - from));
    out->cameras[i].time = time;
  }
  return PAGS_OK;
}

void pags_camera_path_shift(pags_camera_path *path, double metres) {
  for (int64_t i = 0; i < path->count; i++) {
    double *const pose = path->cameras[i].world_from_camera;
    for (int k = 0; k < 3; k++)
      pose[4 * k + 3] += pose[4 * k] * metres;
  }
}
