/* SPDX-License-Identifier: Apache-2.0 */
/* Draws depth views of Gaussians from the training cameras, and answers questions about them.
 *
 * If a pixel sees two surfaces, its mean depth sum(w z) / sum(w) lies between them. Such pixels are recognised by a
 * jump of depth to a neighbouring pixel and count as unknown. */
#include "exporters/proxy/depth_view.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

enum { SOLID = 166, CLEAR = 51 }; /* alpha, 0..255: over 0.65 a surface, under 0.2 nothing, between unknown */

/* Depths of neighbouring pixels that differ by more than this share are of different surfaces. The depth of a plane
 * seen at a grazing angle of 3 degrees changes by a share of 1 / (f tan 3 deg) a pixel: 0.04 at f = 480 px. */
static const float jump = 0.05f;

static const double flatness = 0.3; /* a Gaussian is flat if its smallest scale is at most this share of the next */

void pags_depth_views_destroy(pags_depth_views *depth_views) {
  for (int64_t i = 0; i < depth_views->count; i++) {
    pags_depth_view *view = &depth_views->list[i];
    void *const owned[] = {view->depth, view->plane, view->cover, view->rgb, view->labels, view->lo};
    for (size_t k = 0; k < sizeof owned / sizeof *owned; k++)
      free(owned[k]);
  }
  free(depth_views->list);
  *depth_views = (pags_depth_views){0};
}

/* ---- Making a view ---- */

static uint8_t byte_of(float value) {
  return (uint8_t)(value <= 0 ? 0 : value >= 1 ? 255 : value * 255.0f + 0.5f);
}

/* The plane of a flat Gaussian: its mean, its thinnest axis as normal, and as reach 4 of its largest scales. Returns
 * false if the Gaussian isn't flat. */
static bool plane_of(const pags_part *part, int64_t row, double middle[3], double normal[3], double *reach) {
  const pags_gaussians *g = part->gaussians;
  double scale[3], q[4], r[9], length = 0, mean[3];
  int thin = 0, wide = 0;
  for (int k = 0; k < 3; k++) {
    scale[k] = pags_exp((double)pags_plane(g, PAGS_SCALE + k)[row]);
    mean[k] = (double)pags_plane(g, PAGS_MEAN + k)[row];
    thin = scale[k] < scale[thin] ? k : thin;
    wide = scale[k] > scale[wide] ? k : wide;
  }
  for (int k = 0; k < 4; k++) {
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[row];
    length += q[k] * q[k];
  }
  int other = thin == wide ? thin : 3 - thin - wide;
  if (!(length > 0) || scale[thin] > flatness * scale[other])
    return false;
  pags_rotation_from_quaternion(q, r);
  const double axis[3] = {r[thin], r[3 + thin], r[6 + thin]};
  pags_rigid_point(part->world_from_model, mean, middle);
  pags_rotate3(part->world_from_model, axis, normal);
  *reach = 4 * scale[wide];
  return true;
}

static bool jumps(const float *depth, int64_t at, int64_t other) {
  float a = depth[at], b = depth[other];
  return b > 0 && (a > b ? a - b : b - a) > jump * (a < b ? a : b);
}

/* Marks pixels at depth discontinuities as unknown: their depth may be the mean of two surfaces. */
static void drop_edges(pags_depth_view *depth_view, float *scratch) {
  int w = depth_view->camera.width, h = depth_view->camera.height;
  memcpy(scratch, depth_view->depth, (size_t)w * (size_t)h * sizeof *scratch);
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int64_t at = (int64_t)y * w + x;
      if (scratch[at] > 0 && ((x > 0 && jumps(scratch, at, at - 1)) || (x + 1 < w && jumps(scratch, at, at + 1)) ||
                              (y > 0 && jumps(scratch, at, at - w)) || (y + 1 < h && jumps(scratch, at, at + w))))
        depth_view->depth[at] = PAGS_DEPTH_VIEW_UNKNOWN;
    }
}

void pags_depth_view_bound(pags_depth_view *depth_view) {
  int w = depth_view->camera.width, h = depth_view->camera.height;
  int64_t count = (int64_t)depth_view->cells_x * depth_view->cells_y;
  for (int64_t i = 0; i < count; i++) {
    depth_view->lo[i] = INFINITY;
    depth_view->hi[i] = 0;
  }
  for (int y = 0; y < h; y++)
    for (int x = 0; x < w; x++) {
      int64_t at = (int64_t)(y / PAGS_DEPTH_VIEW_CELL) * depth_view->cells_x + x / PAGS_DEPTH_VIEW_CELL;
      const float depth = fabsf(depth_view->depth[(int64_t)y * w + x]);
      depth_view->lo[at] = depth < depth_view->lo[at] ? depth : depth_view->lo[at];
      depth_view->hi[at] = depth > depth_view->hi[at] ? depth : depth_view->hi[at];
    }
}

void pags_depth_view_flatten(pags_depth_view *depth_view) {
  for (int64_t i = 0; i < (int64_t)depth_view->camera.width * depth_view->camera.height; i++) {
    const float plane = depth_view->plane[i], depth = depth_view->depth[i];
    if (plane > 0 && depth > 0 && fabsf(plane - depth) <= 0.2f * depth)
      depth_view->depth[i] = plane;
  }
  pags_depth_view_bound(depth_view);
}

pags_result pags_depth_views_add(pags_depth_views *depth_views, pags_frame *frame, const pags_part *parts,
                                 int part_count, const pags_camera *camera, const pags_frame_options *options,
                                 int64_t view, bool planes) {
  pags_picture picture;
  const int w = camera->width, h = camera->height;
  const size_t pixels = (size_t)w * (size_t)h;
  const int64_t cells_x = (w + PAGS_DEPTH_VIEW_CELL - 1) / PAGS_DEPTH_VIEW_CELL,
                cells_y = (h + PAGS_DEPTH_VIEW_CELL - 1) / PAGS_DEPTH_VIEW_CELL;
  PAGS_CHECK_MEMORY(
      pags_grow(&depth_views->list, depth_views->count + 1, &depth_views->capacity, sizeof *depth_views->list),
      "%lld views", (long long)depth_views->count + 1);
  PAGS_TRY(pags_frame_render(frame, parts, part_count, camera, options, NULL, NULL, &picture));
  pags_depth_view *depth_view = &depth_views->list[depth_views->count++];
  *depth_view = (pags_depth_view){.camera = *camera,
                                  .blur = sqrt((double)options->low_pass),
                                  .nearest = fmin(0.05, 5 * (double)options->near_plane),
                                  .view = view,
                                  .depth = malloc(pixels * sizeof(float)),
                                  .plane = planes ? malloc(pixels * sizeof(float)) : NULL,
                                  .cover = malloc(pixels),
                                  .rgb = malloc(3 * pixels),
                                  .cells_x = (int)cells_x,
                                  .cells_y = (int)cells_y,
                                  .lo = malloc(2 * (size_t)(cells_x * cells_y) * sizeof(float))};
  PAGS_AUTOFREE float *scratch = malloc(pixels * sizeof *scratch);
  PAGS_CHECK_MEMORY(depth_view->depth && depth_view->cover && (!planes || depth_view->plane) && depth_view->rgb &&
                        depth_view->lo && scratch,
                    "a view of %dx%d", w, h);
  depth_view->hi = depth_view->lo + cells_x * cells_y;
  pags_rigid_inverse(camera->world_from_camera, depth_view->camera_from_model);

  /* Copy alpha, depth and colour; the colour is divided by alpha, which removes the background's share. */
  for (int y = 0; y < picture.height; y++)
    for (int x = 0; x < picture.width; x++) {
      int64_t from = (int64_t)y * picture.stride + x, to = (int64_t)y * picture.width + x;
      float alpha = 1.0f - picture.transmittance[from];
      depth_view->cover[to] = byte_of(alpha);
      depth_view->depth[to] = depth_view->cover[to] > SOLID && picture.depth[from] > 0 ? picture.depth[from]
                              : depth_view->cover[to] < CLEAR                          ? PAGS_DEPTH_VIEW_FREE
                                                                                       : PAGS_DEPTH_VIEW_UNKNOWN;
      for (int c = 0; c < 3; c++)
        depth_view->rgb[3 * to + c] = byte_of(alpha > 0.01f ? picture.rgb[c][from] / alpha : 0);
    }

  if (planes) {
    /* A pixel's depth is a blend of the Gaussians' means, in which nearer Gaussians weigh more. For wide flat
     * Gaussians seen at a grazing angle it lies in front of their plane; the ray's intersection with the plane is
     * exact. */
    double eye[3];
    pags_pose_position(depth_view->camera.world_from_camera, eye);
    for (int y = 0; y < picture.height; y++)
      for (int x = 0; x < picture.width; x++) {
        int64_t to = (int64_t)y * picture.width + x, row = picture.id[(int64_t)y * picture.stride + x];
        double middle[3], normal[3], along[3], up[3], reach, off = 0;
        depth_view->plane[to] = 0;
        if (!(depth_view->depth[to] > 0) || row < 0 || !plane_of(&parts[0], row, middle, normal, &reach))
          continue;
        pags_depth_view_point(depth_view, x, y, 1, along);
        pags_subtract3(along, eye, along);
        pags_subtract3(middle, eye, up);
        const double z = pags_dot3(normal, up) / pags_dot3(normal, along);
        for (int k = 0; k < 3; k++)
          off += pags_pow(eye[k] + z * along[k] - middle[k], 2);
        if (z > 0 && off < reach * reach)
          depth_view->plane[to] = (float)z;
      }
  }
  drop_edges(depth_view, scratch);
  pags_depth_view_bound(depth_view);
  return PAGS_OK;
}

/* ---- Cropping and asking ---- */

bool pags_camera_crop(const pags_camera *camera, const double lo[3], const double hi[3], double near_plane,
                      pags_camera *out) {
  double camera_from_world[12], box[4] = {HUGE_VAL, HUGE_VAL, -HUGE_VAL, -HUGE_VAL};
  int behind = 0;
  pags_rigid_inverse(camera->world_from_camera, camera_from_world);
  for (int i = 0; i < 8; i++) {
    double corner[3], p[3];
    for (int k = 0; k < 3; k++)
      corner[k] = i >> k & 1 ? hi[k] : lo[k];
    pags_rigid_point(camera_from_world, corner, p);
    if (p[2] <= near_plane) {
      behind++;
      continue;
    }
    const double uv[2] = {camera->fx * p[0] / p[2] + camera->cx, camera->fy * p[1] / p[2] + camera->cy};
    for (int k = 0; k < 2; k++) {
      box[k] = fmin(box[k], uv[k]);
      box[2 + k] = fmax(box[2 + k], uv[k]);
    }
  }
  if (behind == 8)
    return false;
  if (behind) { /* the box extends to the side of or behind the camera: keep the whole picture */
    box[0] = box[1] = 0;
    box[2] = camera->width;
    box[3] = camera->height;
  }
  double x0 = fmax(0, floor(box[0]) - 2), y0 = fmax(0, floor(box[1]) - 2);
  double x1 = fmin(camera->width, ceil(box[2]) + 2), y1 = fmin(camera->height, ceil(box[3]) + 2);
  if (x1 - x0 < 1 || y1 - y0 < 1)
    return false;
  *out = *camera;
  out->width = (int)(x1 - x0);
  out->height = (int)(y1 - y0);
  out->cx -= x0;
  out->cy -= y0;
  return true;
}

bool pags_depth_view_may_see(const pags_depth_view *depth_view, const double middle[3], double radius, double range) {
  const pags_camera *c = &depth_view->camera;
  double p[3];
  pags_rigid_point(depth_view->camera_from_model, middle, p);
  if (p[2] < -radius || p[2] > range + radius)
    return false;
  const double edges[2][2] = {{-c->cx / c->fx, (c->width - c->cx) / c->fx},
                              {-c->cy / c->fy, (c->height - c->cy) / c->fy}};
  for (int k = 0; k < 2; k++) {
    double left = (p[k] - edges[k][0] * p[2]) / sqrt(1 + edges[k][0] * edges[k][0]);
    double right = (edges[k][1] * p[2] - p[k]) / sqrt(1 + edges[k][1] * edges[k][1]);
    if (left < -radius || right < -radius)
      return false;
  }
  return true;
}

pags_depth_view_verdict pags_depth_view_classify(const pags_depth_view *depth_view, const double middle[3],
                                                 double radius, double margin, double *z) {
  const pags_camera *c = &depth_view->camera;
  double p[3];
  pags_rigid_point(depth_view->camera_from_model, middle, p);
  *z = p[2];
  double near = p[2] - radius;
  if (near < 0.1)
    return PAGS_DEPTH_VIEW_MIXED;
  /* The projection of any point of the ball differs in u from the middle's by at most
   *     f r (1 + |x / z|) / (z - r). */
  double u = c->fx * p[0] / p[2] + c->cx, v = c->fy * p[1] / p[2] + c->cy;
  double du = c->fx * radius * (1 + fabs(p[0] / p[2])) / near, dv = c->fy * radius * (1 + fabs(p[1] / p[2])) / near;
  if (!(u - du >= 0 && v - dv >= 0 && u + du < c->width && v + dv < c->height))
    return PAGS_DEPTH_VIEW_MIXED;
  int x0 = (int)(u - du) / PAGS_DEPTH_VIEW_CELL, x1 = (int)(u + du) / PAGS_DEPTH_VIEW_CELL;
  int y0 = (int)(v - dv) / PAGS_DEPTH_VIEW_CELL, y1 = (int)(v + dv) / PAGS_DEPTH_VIEW_CELL;
  double lo = HUGE_VAL, hi = 0;
  for (int y = y0; y <= y1; y++)
    for (int x = x0; x <= x1; x++) {
      lo = fmin(lo, (double)depth_view->lo[(int64_t)y * depth_view->cells_x + x]);
      hi = fmax(hi, (double)depth_view->hi[(int64_t)y * depth_view->cells_x + x]);
    }
  return lo >= p[2] + radius + margin ? PAGS_DEPTH_VIEW_CLEAR
         : hi < near - margin         ? PAGS_DEPTH_VIEW_HIDDEN
                                      : PAGS_DEPTH_VIEW_MIXED;
}

bool pags_depth_view_project(const pags_depth_view *depth_view, const double point[3], int *x, int *y, double *z) {
  double p[3];
  const pags_camera *camera = &depth_view->camera;
  pags_rigid_point(depth_view->camera_from_model, point, p);
  if (p[2] <= depth_view->nearest)
    return false;
  double u = camera->fx * p[0] / p[2] + camera->cx, v = camera->fy * p[1] / p[2] + camera->cy;
  if (!(u >= 0 && v >= 0 && u < camera->width && v < camera->height))
    return false;
  *x = (int)u;
  *y = (int)v;
  *z = p[2];
  return true;
}

void pags_depth_view_point(const pags_depth_view *depth_view, int x, int y, double z, double point[3]) {
  const pags_camera *camera = &depth_view->camera;
  const double p[3] = {(x + 0.5 - camera->cx) / camera->fx * z, (y + 0.5 - camera->cy) / camera->fy * z, z};
  pags_rigid_point(camera->world_from_camera, p, point);
}

bool pags_depth_view_normal(const pags_depth_view *depth_view, int x, int y, int side, int next, const double p[3],
                            double n[3]) {
  const int64_t width = depth_view->camera.width;
  const double a = (double)depth_view->depth[y * width + side], b = (double)depth_view->depth[next * width + x];
  double q[3], r[3];
  if (!(a > 0 && b > 0))
    return false;
  pags_depth_view_point(depth_view, side, y, a, q);
  pags_depth_view_point(depth_view, x, next, b, r);
  pags_subtract3(q, p, q);
  pags_subtract3(r, p, r);
  pags_cross3(q, r, n);
  return true;
}

/* ---- Work that can be cancelled ---- */

pags_result pags_proxy_for(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn, void *context) {
  return pags_parallel_for(tasks, count, grain, fn, context) ? PAGS_OK : pags_fail(PAGS_CANCELLED, "interrupted");
}

pags_result pags_proxy_tell(pags_progress_fn *tell, void *user, double fraction, const char *what) {
  return !tell || tell(user, fraction, what) ? PAGS_OK : pags_fail(PAGS_CANCELLED, "interrupted");
}
