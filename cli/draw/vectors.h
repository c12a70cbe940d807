/* SPDX-License-Identifier: Apache-2.0 */
/* Vectors of three doubles by value, and columns of a camera pose, for camera paths. */
#ifndef PAGS_CLI_VECTORS_H
#define PAGS_CLI_VECTORS_H

#include <math.h>
#include <pags/scene.h>

typedef struct pags_vec3 {
  double x, y, z;
} pags_vec3;

static inline pags_vec3 pags_vec_add(pags_vec3 a, pags_vec3 b) {
  return (pags_vec3){a.x + b.x, a.y + b.y, a.z + b.z};
}
static inline pags_vec3 pags_vec_scale(pags_vec3 a, double s) {
  return (pags_vec3){a.x * s, a.y * s, a.z * s};
}
static inline pags_vec3 pags_vec_sub(pags_vec3 a, pags_vec3 b) {
  return (pags_vec3){a.x - b.x, a.y - b.y, a.z - b.z};
}
static inline double pags_vec_dot(pags_vec3 a, pags_vec3 b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
static inline double pags_vec_length(pags_vec3 a) {
  return sqrt(pags_vec_dot(a, a));
}
static inline pags_vec3 pags_vec_cross(pags_vec3 a, pags_vec3 b) {
  return (pags_vec3){a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
static inline pags_vec3 pags_vec_normalized(pags_vec3 a) {
  double l = pags_vec_length(a);
  return l > 0 ? pags_vec_scale(a, 1 / l) : a;
}

/* Returns column `c` of world_from_camera: 0 right, 1 down, 2 forward, 3 position. */
static inline pags_vec3 pags_camera_column(const pags_camera *camera, int c) {
  const double *m = camera->world_from_camera;
  return (pags_vec3){m[c], m[4 + c], m[8 + c]};
}

static inline void pags_camera_set_column(pags_camera *camera, int c, pags_vec3 v) {
  double *m = camera->world_from_camera;
  m[c] = v.x;
  m[4 + c] = v.y;
  m[8 + c] = v.z;
}

/* The mean of the cameras' up axes if they agree; else the up axis of the scene. */
pags_vec3 pags_cameras_up(const pags_scene *scene);

#endif
