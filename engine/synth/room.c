/* SPDX-License-Identifier: Apache-2.0 */
/* The courtyard: a floor, four walls, and things about the middle of sizes from 0.1 to 1.4 m. */
#include "synth/room.h"

#include <math.h>

#define CHECKER PAGS_PATTERN_CHECKER
#define STRIPES PAGS_PATTERN_STRIPES
#define MARBLE PAGS_PATTERN_MARBLE

static const pags_box boxes[] = {
    /* The floor's upper face is z = 0, the walls' inner faces are x, y = +-4. */
    {{0, 0, -0.1f}, {4.2f, 4.2f, 0.1f}, 0, {CHECKER, 0.8f, {{0.55f, 0.50f, 0.42f}, {0.20f, 0.22f, 0.26f}}, 0.45f}},
    {{4.1f, 0, 1.5f}, {0.1f, 4.2f, 1.5f}, 0, {MARBLE, 0.9f, {{0.62f, 0.42f, 0.28f}, {0.45f, 0.25f, 0.18f}}, 0.3f}},
    {{-4.1f, 0, 1.5f}, {0.1f, 4.2f, 1.5f}, 0, {STRIPES, 0.7f, {{0.25f, 0.40f, 0.55f}, {0.60f, 0.62f, 0.60f}}, 0.3f}},
    {{0, 4.1f, 1.5f}, {4.2f, 0.1f, 1.5f}, 0, {CHECKER, 0.5f, {{0.50f, 0.52f, 0.30f}, {0.36f, 0.42f, 0.24f}}, 0.4f}},
    {{0, -4.1f, 1.5f}, {4.2f, 0.1f, 1.5f}, 0, {MARBLE, 0.6f, {{0.60f, 0.58f, 0.62f}, {0.32f, 0.26f, 0.40f}}, 0.3f}},
    /* A chest, a post, a low table of two boxes, a beam, a pedestal. */
    {{0.55f, 0.35f, 0.35f},
     {0.5f, 0.35f, 0.35f},
     0.5f,
     {STRIPES, 0.2f, {{0.70f, 0.16f, 0.10f}, {0.75f, 0.60f, 0.30f}}, 0.3f}},
    {{-0.75f, 0.7f, 0.7f},
     {0.14f, 0.14f, 0.7f},
     0.9f,
     {CHECKER, 0.14f, {{0.85f, 0.85f, 0.80f}, {0.08f, 0.10f, 0.14f}}, 0.2f}},
    {{-0.5f, -0.7f, 0.45f},
     {0.55f, 0.4f, 0.05f},
     -0.3f,
     {MARBLE, 0.25f, {{0.45f, 0.28f, 0.12f}, {0.65f, 0.45f, 0.22f}}, 0.4f}},
    {{-0.5f, -0.7f, 0.2f},
     {0.2f, 0.2f, 0.2f},
     -0.3f,
     {MARBLE, 0.2f, {{0.30f, 0.18f, 0.08f}, {0.45f, 0.30f, 0.15f}}, 0.4f}},
    {{0.9f, -0.75f, 0.08f},
     {0.7f, 0.08f, 0.08f},
     1.1f,
     {STRIPES, 0.12f, {{0.80f, 0.75f, 0.10f}, {0.06f, 0.06f, 0.06f}}, 0.1f}},
    {{0.1f, 1.25f, 0.2f},
     {0.2f, 0.2f, 0.2f},
     0.2f,
     {CHECKER, 0.1f, {{0.15f, 0.45f, 0.50f}, {0.70f, 0.75f, 0.72f}}, 0.2f}},
};

static const pags_ball balls[] = {
    {{0.55f, 0.35f, 1.0f}, 0.3f, {MARBLE, 0.2f, {{0.15f, 0.50f, 0.22f}, {0.75f, 0.80f, 0.45f}}, 0.2f}},
    {{-0.65f, -0.7f, 0.68f}, 0.18f, {STRIPES, 0.1f, {{0.80f, 0.35f, 0.08f}, {0.85f, 0.80f, 0.70f}}, 0.1f}},
    {{-0.25f, -0.65f, 0.6f}, 0.1f, {CHECKER, 0.07f, {{0.20f, 0.22f, 0.65f}, {0.75f, 0.70f, 0.75f}}, 0.1f}},
    {{0.1f, 1.25f, 0.65f}, 0.25f, {CHECKER, 0.15f, {{0.75f, 0.15f, 0.35f}, {0.80f, 0.70f, 0.60f}}, 0.2f}},
    {{-1.4f, -0.1f, 0.3f}, 0.3f, {MARBLE, 0.35f, {{0.65f, 0.60f, 0.15f}, {0.25f, 0.20f, 0.30f}}, 0.3f}},
    {{0.15f, -0.15f, 0.15f}, 0.15f, {STRIPES, 0.15f, {{0.55f, 0.20f, 0.60f}, {0.80f, 0.80f, 0.85f}}, 0.1f}},
};

const pags_room *pags_room_get(void) {
  static const pags_room room = {
      .box_count = sizeof boxes / sizeof *boxes,
      .ball_count = sizeof balls / sizeof *balls,
      .boxes = boxes,
      .balls = balls,
      .sun = {0.48f, -0.36f, 0.8f},
      .sun_light = {0.95f, 0.90f, 0.80f},
      .sky_light = {0.42f, 0.48f, 0.58f},
  };
  return &room;
}

void pags_box_local(const pags_box *box, const float world[3], float local[3]) {
  const float c = cosf(box->yaw), s = sinf(box->yaw), x = world[0] - box->center[0], y = world[1] - box->center[1];
  local[0] = c * x + s * y;
  local[1] = c * y - s * x;
  local[2] = world[2] - box->center[2];
}

void pags_box_corner(const pags_box *box, int index, float world[3]) {
  float p[3];
  for (int k = 0; k < 3; k++)
    p[k] = index >> k & 1 ? box->half[k] : -box->half[k];
  const float c = cosf(box->yaw), s = sinf(box->yaw);
  world[0] = box->center[0] + c * p[0] - s * p[1];
  world[1] = box->center[1] + s * p[0] + c * p[1];
  world[2] = box->center[2] + p[2];
}

/* Columns of `m` (3x4): right, down, forward, eye; world z is up. */
static void look_at(const double eye[3], const double target[3], double m[12]) {
  double f[3], flat, length;
  for (int k = 0; k < 3; k++)
    f[k] = target[k] - eye[k];
  length = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
  for (int k = 0; k < 3; k++)
    f[k] /= length;
  flat = sqrt(f[0] * f[0] + f[1] * f[1]);
  const double r[3] = {f[1] / flat, -f[0] / flat, 0.0};
  const double d[3] = {f[1] * r[2] - f[2] * r[1], f[2] * r[0] - f[0] * r[2], f[0] * r[1] - f[1] * r[0]};
  for (int k = 0; k < 3; k++) {
    m[4 * k] = r[k];
    m[4 * k + 1] = d[k];
    m[4 * k + 2] = f[k];
    m[4 * k + 3] = eye[k];
  }
}

pags_camera pags_room_camera(int index, int views, int width, int height) {
  const double angle = 6.283185307179586 * index / views;
  const double eye[3] = {3.0 * cos(angle), 3.0 * sin(angle), 1.5 + 0.35 * sin(5.0 * angle)};
  const double target[3] = {0.0, 0.0, 0.5};
  pags_camera camera = {.width = width, .height = height, .cx = 0.5 * width, .cy = 0.5 * height, .time = NAN};
  camera.fx = camera.fy = 0.5 * width / tan(0.5 * 1.15); /* 66 degrees across */
  look_at(eye, target, camera.world_from_camera);
  return camera;
}
