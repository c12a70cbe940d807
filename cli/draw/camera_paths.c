/* SPDX-License-Identifier: Apache-2.0 */
/* Computes the camera paths of camera_paths.h: positions by Catmull-Rom splines, rotations by spherical
 * interpolation; orbits are in orbit.c. World coordinates are absolute, in double. */
#include "cli/draw/camera_paths.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "cli/draw/vectors.h"
#include "maths/maths.h"

enum { PATH_FPS = 30 };

static pags_result create_path(int64_t frames, pags_camera_path *out) {
  *out = (pags_camera_path){.fps = PATH_FPS, .count = frames, .cameras = calloc((size_t)frames, sizeof *out->cameras)};
  if (!out->cameras)
    return pags_out_of_memory("a path of %lld frames", (long long)frames);
  return PAGS_OK;
}

/* ---- Flights through the training views ---- */

static double catmull_rom(double a, double b, double c, double d, double t) {
  return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)));
}

static pags_vec3 catmull_rom3(pags_vec3 a, pags_vec3 b, pags_vec3 c, pags_vec3 d, double t) {
  return (pags_vec3){catmull_rom(a.x, b.x, c.x, d.x, t), catmull_rom(a.y, b.y, c.y, d.y, t),
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

/* Interpolates a camera at parameter t (0..1) between keyframes[1] and keyframes[2]; keyframes[0] and keyframes[3]
 * shape the position spline. Picture size and intrinsics are those of `lens`. */
static pags_camera between(const pags_camera *const keyframes[4], const pags_camera *lens, double t) {
  pags_camera camera = *lens;
  const pags_camera *a = keyframes[1], *b = keyframes[2];
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
    pags_camera_set_column(&camera, c, (pags_vec3){r[c], r[3 + c], r[6 + c]});
  pags_camera_set_column(&camera, 3,
                         catmull_rom3(pags_camera_column(keyframes[0], 3), pags_camera_column(a, 3),
                                      pags_camera_column(b, 3), pags_camera_column(keyframes[3], 3), t));
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
  const pags_camera **keyframes = calloc(views + 1, sizeof *keyframes);
  double *reached = calloc(views + 1, sizeof *reached); /* path length up to each keyframe, metres */
  int64_t count = 0;
  pags_result result = keyframes && reached ? PAGS_OK : pags_out_of_memory(NULL);
  for (size_t i = 0; result == PAGS_OK && i < views; i++)
    if (!scene->views[i].test)
      keyframes[count++] = &scene->views[i].camera;
  if (result == PAGS_OK && count < 2)
    result = pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 training views; the scene has %lld",
                       (long long)count);
  if (result == PAGS_OK)
    result = create_path(frames, out);
  for (int64_t i = 1; result == PAGS_OK && i < count; i++)
    reached[i] = reached[i - 1] + fmax(pags_vec_length(pags_vec_sub(pags_camera_column(keyframes[i], 3),
                                                                    pags_camera_column(keyframes[i - 1], 3))),
                                       1e-9);
  int64_t keyframe = 0;
  for (int64_t i = 0; result == PAGS_OK && i < frames; i++) {
    double at = frames > 1 ? reached[count - 1] * (double)i / (double)(frames - 1) : 0;
    while (keyframe + 2 < count && reached[keyframe + 1] < at)
      keyframe++;
    const pags_camera *around[4] = {keyframes[keyframe > 0 ? keyframe - 1 : 0], keyframes[keyframe],
                                    keyframes[keyframe + 1],
                                    keyframes[keyframe + 2 < count ? keyframe + 2 : keyframe + 1]};
    double t = (at - reached[keyframe]) / (reached[keyframe + 1] - reached[keyframe]);
    out->cameras[i] = between(around, keyframes[0], fmin(fmax(t, 0), 1));
  }
  free(keyframes);
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

/* Interpolates the camera at `time`, which lies between the first and the last of `keyframes`. *keyframe is the index
 * of the keyframe before it; calls must be in order of time, since it only grows. */
static pags_camera driven(const pags_camera *const *keyframes, int64_t count, double time, int64_t *keyframe) {
  while (*keyframe + 2 < count && keyframes[*keyframe + 1]->time <= time)
    ++*keyframe;
  const pags_camera *a = keyframes[*keyframe], *b = keyframes[*keyframe + 1];
  const pags_camera *around[4] = {keyframes[*keyframe > 0 ? *keyframe - 1 : 0], a, b,
                                  keyframes[*keyframe + 2 < count ? *keyframe + 2 : *keyframe + 1]};
  pags_camera camera = between(around, keyframes[0], fmin(fmax((time - a->time) / (b->time - a->time), 0), 1));
  camera.time = time;
  return camera;
}

static pags_result drive(const pags_camera *const *keyframes, int64_t count, int64_t frames, double fps,
                         pags_camera_path *out) {
  if (count < 2)
    return pags_fail(PAGS_ERROR_ARGUMENT, "an ego path needs at least 2 views of the first sensor; the scene has %lld",
                     (long long)count);
  double begin = keyframes[0]->time, span = keyframes[count - 1]->time - begin, even = span * fps;
  bool recorded = frames == 0 && fps == 0;
  if (even > 1e6)
    return pags_fail(PAGS_ERROR_ARGUMENT, "--fps: %g frames/s for %g s are more than a million frames", fps, span);
  int64_t total = frames ? frames : recorded ? count : (int64_t)(even + 1e-6) + 1;
  PAGS_TRY(create_path(total, out));
  int64_t keyframe = 0;
  for (int64_t i = 0; i < total; i++) {
    double share = total > 1 ? (double)i / (double)(total - 1) : 0;
    double time = recorded ? keyframes[i]->time : frames ? begin + share * span : begin + (double)i / fps;
    out->cameras[i] = driven(keyframes, count, fmin(time, begin + span), &keyframe);
  }
  return PAGS_OK;
}

pags_result pags_camera_path_drive(const pags_scene *scene, int64_t frames, double fps, pags_camera_path *out) {
  const pags_camera **keyframes = calloc((size_t)scene->view_count + 1, sizeof *keyframes);
  if (!keyframes)
    return pags_out_of_memory(NULL);
  pags_result result = drive(keyframes, first_sensor(scene, keyframes), frames, fps, out);
  free(keyframes);
  return result;
}

void pags_camera_path_shift(pags_camera_path *path, double metres) {
  for (int64_t i = 0; i < path->count; i++) {
    pags_camera *camera = &path->cameras[i];
    pags_camera_set_column(
        camera, 3, pags_vec_add(pags_camera_column(camera, 3), pags_vec_scale(pags_camera_column(camera, 0), metres)));
  }
}
