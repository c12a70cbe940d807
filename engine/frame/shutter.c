/* SPDX-License-Identifier: Apache-2.0 */
/* Rolling shutter: how each part, and the directions of the sky's pixels, move while the picture is read. The kernels
 * (simd/scan.h) find from it when each Gaussian is read. */
#include <math.h>
#include <string.h>

#include "base/vec3.h"
#include "frame/stages.h"

void pags_frame_pose(const double world_from_camera[12], const double origin[3], const double world_from_model[12],
                     double camera_from_model[12], double model_from_camera[12]) {
  double local[12], camera_from_world[12];
  memcpy(local, world_from_camera, sizeof local);
  pags_pose_subtract(local, origin);
  pags_rigid_inverse(local, camera_from_world);
  pags_rigid_multiply(camera_from_world, world_from_model, camera_from_model);
  pags_affine_inverse(camera_from_model, model_from_camera);
}

/* The coefficients of u and u^2 of the parabola with these values at -1/2, 0 and 1/2. */
static void parabola(double before, double middle, double after, float *first, float *second) {
  *first = (float)(after - before);
  *second = (float)(2.0 * (after + before) - 4.0 * middle);
}

pags_result pags_frame_scan(pags_frame *frame) {
  const pags_camera *const c = &frame->camera;
  const double direction = c->shutter.across + c->shutter.down > 0.0 ? 1.0 : -1.0;
  const double read_out = fabs(c->shutter.across + c->shutter.down); /* one of them is 0 */
  frame->scans = NULL;
  frame->counts = NULL;
  if (!pags_camera_rolls(c))
    return PAGS_OK;
  PAGS_TRY(pags_frame_alloc(frame, &frame->scans, frame->part_count, sizeof *frame->scans, "parts"));
  for (int p = 0; p < frame->part_count; p++) {
    const pags_part *const part = frame->parts + p;
    pags_scan *const scan = frame->scans + p;
    double pose[3][12], eye[3][3]; /* at the beginning, in the middle and at the end */
    for (int k = 0; k < 3; k++) {
      const double seconds = 0.5 * (k - 1) * read_out;
      double camera[12], model[12], model_from_camera[12];
      pags_rigid_move(c->world_from_camera, c->shutter.velocity, seconds, camera);
      pags_rigid_move(part->world_from_model, part->velocity, seconds, model);
      pags_frame_pose(camera, frame->options.origin, model, pose[k], model_from_camera);
      pags_pose_position(model_from_camera, eye[k]);
    }
    *scan = (pags_scan){.x = (float)(c->shutter.across != 0.0 ? direction / c->width : 0.0),
                        .y = (float)(c->shutter.down != 0.0 ? direction / c->height : 0.0),
                        .start = (float)(-0.5 * direction)};
    for (int i = 0; i < 3; i++) {
      for (int k = 0; k < 3; k++)
        parabola(pose[0][4 * i + k], pose[1][4 * i + k], pose[2][4 * i + k], scan->r1 + 3 * i + k,
                 scan->r2 + 3 * i + k);
      parabola(pose[0][4 * i + 3], pose[1][4 * i + 3], pose[2][4 * i + 3], scan->t1 + i, scan->t2 + i);
      parabola(eye[0][i], eye[1][i], eye[2][i], scan->eye1 + i, scan->eye2 + i);
    }
    frame->projections[p].scan = scan;
  }
  return PAGS_OK;
}

/* Within a tile the directions are linear in the pixel: those at the tile's middle, and how they change from there by
 * the pixel and by the camera's rotation until it is read. The error is less than 1e-3 px at a radian a second.
 */
pags_sky_rays pags_frame_rays(const pags_frame *frame, int64_t tile) {
  const pags_camera *const c = &frame->camera;
  pags_sky_rays rays = frame->rays;
  if (!pags_camera_rolls(c))
    return rays;
  const double x = frame_tile_x(frame, tile) + 0.5 * PAGS_TILE, y = frame_tile_y(frame, tile) + 0.5 * PAGS_TILE;
  const double u = (x - c->cx) / c->fx, v = (y - c->cy) / c->fy, *const w = c->shutter.velocity;
  const double turned[3] = {w[1] - w[2] * v, w[2] * u - w[0], w[0] * v - w[1] * u}; /* w x (u, v, 1) */
  double m[12];
  pags_rigid_move(c->world_from_camera, c->shutter.velocity, pags_camera_read_at(c, x, y), m);
  for (int k = 0; k < 3; k++) {
    const double *const r = m + 4 * k, rate = pags_dot3(r, turned);
    const double across = r[0] / c->fx + rate * c->shutter.across / c->width,
                 down = r[1] / c->fy + rate * c->shutter.down / c->height;
    rays.across[k] = (float)across;
    rays.downwards[k] = (float)down;
    rays.forward[k] = (float)(r[0] * u + r[1] * v + r[2] - (x - c->cx) * across - (y - c->cy) * down);
  }
  return rays;
}
