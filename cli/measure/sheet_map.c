/* SPDX-License-Identifier: Apache-2.0 */
/* Draws the map of a data set (overlay_draw.h): ground first, then boxes, the cameras on top. */
#include "cli/measure/overlay_draw.h"

#include <math.h>

#include "base/memory.h"
#include "base/vec3.h"
#include "maths/maths.h"

static const uint8_t path_colour[3] = {40, 90, 220}, held_colour[3] = {220, 40, 40}, cone_colour[3] = {20, 40, 120},
                     bar_colour[3] = {0, 0, 0}, parked_colour[3] = {150, 150, 150}, lidar_colour[3] = {165, 165, 165};
static const uint8_t category_colours[4][3] = {{120, 120, 120}, {0, 150, 150}, {200, 40, 200}, {200, 140, 0}};

static void centre_of(const pags_dataset *dataset, int64_t view, double out[3]) {
  pags_pose_position(pags_dataset_view(dataset, view)->camera.world_from_camera, out);
}

/* ---- Where it lies ---- */

/* Sets two axes of the ground plane, seen from above: the second is a quarter turn to the left of the first. The
 * cameras' way is longest along the first: the principal axis of their positions. */
static void ground_axes(const pags_dataset *dataset, double right[3], double forward[3]) {
  const pags_up up = pags_dataset_up(dataset);
  const double x[3] = {1, 0, 0};
  const double y[3] = {0, up != PAGS_UP_MINUS_Y && up != PAGS_UP_Y,
                       up == PAGS_UP_MINUS_Y ? 1
                       : up == PAGS_UP_Y     ? -1
                                             : 0};
  const int64_t count = pags_dataset_view_count(dataset);
  double mean[2] = {0}, xx = 0, xy = 0, yy = 0, centre[3];
  for (int64_t i = 0; i < count; i++) {
    centre_of(dataset, i, centre);
    mean[0] += pags_dot3(centre, x) / (double)count;
    mean[1] += pags_dot3(centre, y) / (double)count;
  }
  for (int64_t i = 0; i < count; i++) {
    centre_of(dataset, i, centre);
    const double dx = pags_dot3(centre, x) - mean[0], dy = pags_dot3(centre, y) - mean[1];
    xx += dx * dx;
    xy += dx * dy;
    yy += dy * dy;
  }
  const double angle = 0.5 * pags_atan2(2 * xy, xx - yy), c = pags_cos(angle), s = pags_sin(angle);
  for (int k = 0; k < 3; k++) {
    right[k] = c * x[k] + s * y[k];
    forward[k] = c * y[k] - s * x[k];
  }
}

pags_map pags_map_fit(const pags_dataset *dataset, int width, int most_height) {
  pags_map map;
  double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
  double forward[3];
  ground_axes(dataset, map.across, forward);
  pags_scale3(-1, forward, map.down);
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    double c[3];
    centre_of(dataset, i, c);
    const double p[2] = {pags_dot3(c, map.across), pags_dot3(c, map.down)};
    for (int k = 0; k < 2; k++) {
      low[k] = fmin(low[k], p[k]);
      high[k] = fmax(high[k], p[k]);
    }
  }
  /* A drive has 25 m around it; a capture as much as it is wide. */
  const double way = fmax(high[0] - low[0], high[1] - low[1]);
  const double around = pags_dataset_fps(dataset) > 0 ? 25 : fmax(0.5 * way, 1e-3);
  const double size[2] = {high[0] - low[0] + 2 * around, high[1] - low[1] + 2 * around};
  map.scale = fmin(width / size[0], most_height / size[1]);
  map.width = width;
  map.height = (int)fmax(1, fmin(ceil(map.scale * size[1]), most_height));
  for (int k = 0; k < 2; k++)
    map.at[k] = 0.5 * (k ? map.height : map.width) - map.scale * 0.5 * (low[k] + high[k]);
  return map;
}

/* ---- What is on it ---- */

typedef struct drawing {
  const pags_map *map;
  const pags_dataset *dataset;
  pags_image *image;
  int top;
} drawing;

static bool to_pixel(const drawing *d, const double world[3], double out[2]) {
  out[0] = d->map->scale * pags_dot3(world, d->map->across) + d->map->at[0];
  out[1] = d->map->scale * pags_dot3(world, d->map->down) + d->map->at[1];
  const bool inside = out[0] >= 0 && out[0] < d->map->width && out[1] >= 0 && out[1] < d->map->height;
  out[1] += d->top;
  return inside;
}

static void draw_point(const drawing *d, const double world[3], int half, const uint8_t rgb[3]) {
  double at[2];
  if (to_pixel(d, world, at))
    pags_draw_dot(d->image, at[0], at[1], half, rgb);
}

/* Whether the time step `frame` is of one of the numbered views. */
static bool is_numbered(const drawing *d, const int64_t *views, int count, int64_t frame) {
  for (int v = 0; v < count; v++)
    if (pags_dataset_view(d->dataset, views[v])->frame == frame)
      return true;
  return false;
}

/* Draws the sweeps of the numbered time steps or, where there is no LiDAR, the data set's points. */
static pags_result draw_ground(const drawing *d, const int64_t *views, int count) {
  const int64_t sweeps = pags_dataset_sweep_count(d->dataset);
  double p[3], world[3];
  int64_t points;
  for (int64_t i = 0; i < sweeps; i++) {
    const pags_sweep *const sweep = pags_dataset_sweep(d->dataset, i);
    if (!is_numbered(d, views, count, sweep->frame))
      continue;
    PAGS_AUTOFREE float *xyz = NULL;
    PAGS_TRY(pags_dataset_sweep_load(d->dataset, i, &points, &xyz));
    for (int64_t k = 0; k < points; k++) {
      pags_widen3(xyz + 3 * k, p);
      pags_rigid_point(sweep->world_from_sweep, p, world);
      draw_point(d, world, 0, lidar_colour);
    }
  }
  const float *xyz;
  const uint8_t *rgb;
  int random;
  pags_dataset_points(d->dataset, &points, &xyz, &rgb, &random);
  if (sweeps > 0 || random)
    return PAGS_OK;
  for (int64_t i = 0; i < points; i++) {
    pags_widen3(xyz + 3 * i, p);
    pags_add3(p, pags_dataset_origin(d->dataset), world);
    draw_point(d, world, 0, rgb + 3 * i);
  }
  return PAGS_OK;
}

/* Draws the bases of the boxes, with a stroke from the middle to the front. */
static void draw_boxes(const drawing *d, const int64_t *views, int count) {
  static const double corners[6][2] = {{0.5, 0.5}, {-0.5, 0.5}, {-0.5, -0.5}, {0.5, -0.5}, {0, 0}, {0.5, 0}};
  for (int64_t i = 0; i < pags_dataset_object_count(d->dataset); i++) {
    const pags_object *const object = pags_dataset_object(d->dataset, i);
    const uint8_t *const rgb = object->moving ? category_colours[object->category] : parked_colour;
    for (int v = 0; v < count; v++) {
      double pose[12], pixels[6][2];
      bool inside = true;
      if (!pags_object_pose(object, pags_dataset_view(d->dataset, views[v])->camera.time, pose))
        continue;
      for (int c = 0; c < 6; c++) {
        double world[3];
        for (int k = 0; k < 3; k++)
          world[k] = pose[4 * k] * corners[c][0] * object->size[0] + pose[4 * k + 1] * corners[c][1] * object->size[1] +
                     pose[4 * k + 3];
        inside = to_pixel(d, world, pixels[c]) && inside;
      }
      if (inside) {
        for (int c = 0; c < 4; c++)
          pags_draw_line(d->image, pixels[c], pixels[(c + 1) % 4], rgb);
        pags_draw_line(d->image, pixels[4], pixels[5], rgb);
      }
      if (!object->moving)
        break;
    }
  }
}

/* Draws a camera's edges of view, 30 pixels long, as they point on the ground. */
static void draw_cone(const drawing *d, const pags_camera *camera) {
  enum { LENGTH = 30 };
  double at[2], centre[3];
  pags_pose_position(camera->world_from_camera, centre);
  if (!to_pixel(d, centre, at))
    return;
  for (int side = 0; side < 2; side++) {
    const double x = ((side ? camera->width : 0) - camera->cx) / camera->fx;
    double way[3], end[2], ray[3] = {x, 0, 1};
    if (pags_camera_bends(camera) && !pags_camera_look(camera, side ? camera->width : 0, camera->cy, ray)) {
      const double widest = pags_lens_model_widest(&camera->lens);
      ray[0] = (side ? 1 : -1) * pags_sin(widest), ray[1] = 0, ray[2] = pags_cos(widest);
    }
    for (int k = 0; k < 3; k++)
      way[k] = camera->world_from_camera[4 * k] * ray[0] + camera->world_from_camera[4 * k + 2] * ray[2];
    end[0] = pags_dot3(way, d->map->across);
    end[1] = pags_dot3(way, d->map->down);
    const double length = sqrt(end[0] * end[0] + end[1] * end[1]);
    for (int k = 0; k < 2; k++)
      end[k] = at[k] + (length > 0 ? LENGTH * end[k] / length : 0);
    if (end[0] >= 0 && end[0] < d->map->width && end[1] >= d->top && end[1] < d->top + d->map->height)
      pags_draw_line(d->image, at, end, cone_colour);
  }
}

static void draw_cameras(const drawing *d, const int64_t *views, int count) {
  for (int v = 0; v < count; v++)
    draw_cone(d, &pags_dataset_view(d->dataset, views[v])->camera);
  for (int pass = 0; pass < 2; pass++) /* held-out ones on top */
    for (int64_t i = 0; i < pags_dataset_view_count(d->dataset); i++) {
      double centre[3];
      centre_of(d->dataset, i, centre);
      if ((pags_dataset_view(d->dataset, i)->test != 0) == pass)
        draw_point(d, centre, 1, pass ? held_colour : path_colour);
    }
  for (int v = 0; v < count; v++) {
    const pags_view *const view = pags_dataset_view(d->dataset, views[v]);
    double centre[3], at[2];
    centre_of(d->dataset, views[v], centre);
    const bool first = view->frame < 0 || v == 0 || pags_dataset_view(d->dataset, views[v - 1])->frame != view->frame;
    if (first && to_pixel(d, centre, at))
      pags_draw_number(d->image, (int)at[0] + 6, (int)at[1] + 6, view->frame < 0 ? views[v] : view->frame);
  }
}

/* Draws a bar of 1, 2 or 5 times a power of ten, a sixth of the map long at most, and its length if that is whole. */
static void draw_bar(const drawing *d) {
  const double most = d->map->width / 6.0 / d->map->scale, power = pags_pow(10, floor(pags_log10(most)));
  const double length = power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1);
  const double y = d->top + d->map->height - 12, a[2] = {12, y}, b[2] = {12 + length * d->map->scale, y};
  pags_draw_line(d->image, a, b, bar_colour);
  pags_draw_line(d->image, (double[]){a[0], y - 6}, a, bar_colour);
  pags_draw_line(d->image, (double[]){b[0], y - 6}, b, bar_colour);
  if (length >= 1)
    pags_draw_number(d->image, 18, (int)y - 18, (int64_t)(length + 0.5));
}

pags_result pags_map_draw(const pags_map *map, const pags_dataset *dataset, const int64_t *views, int count,
                          pags_image *image, int top) {
  const drawing d = {map, dataset, image, top};
  PAGS_TRY(draw_ground(&d, views, count));
  draw_boxes(&d, views, count);
  draw_cameras(&d, views, count);
  draw_bar(&d);
  return PAGS_OK;
}
