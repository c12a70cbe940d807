/* SPDX-License-Identifier: Apache-2.0 */
/* Lays out and draws the sheet of a data set (info.h): choose the views, place their cells, fill them, add the map. */
#include "cli/measure/info.h"

#include "cli/common/progress.h"
#include "cli/measure/overlay_draw.h"

#include <math.h>
#include <stdio.h>
#include "base/vec3.h"
#include "dataset/owners.h"
#include "image/pixels.h"
#include "maths/maths.h"

enum { WIDTH = 1600, COLUMNS = 8, MOST_ROWS = 12, STATIC_ROWS = 4, MARGIN = 36, GAP = 4, MOST_MAP = 1000 };

typedef struct sheet {
  const pags_dataset *dataset;
  bool drive;
  int rows, count; /* of cells: count is at most rows * COLUMNS */
  int64_t views[MOST_ROWS * COLUMNS];
  int row_of[MOST_ROWS * COLUMNS], column_of[MOST_ROWS * COLUMNS];
  int sensors[MOST_ROWS]; /* of a drive, by row */
  int top[MOST_ROWS + 1]; /* pixel rows at which rows of cells begin; the last: where the map does */
  pags_image *image;
  /* Projection of the map: pixel x = scale * (p . across) + at[0], y = scale * (p . down) + at[1]. */
  double across[3], down[3]; /* unit vectors of the world on the ground plane */
  double scale;              /* pixels per world unit */
  double at[2];
  int map_height; /* pixels */
} sheet;

/* ---- Layout ---- */

/* One row per camera; the columns are evenly spaced time steps. */
static void choose_drive(sheet *s) {
  const int64_t count = pags_dataset_view_count(s->dataset);
  int64_t steps = 0, step = -1;
  for (int64_t i = 0; i < count; i++) {
    const int sensor = pags_dataset_view(s->dataset, i)->sensor;
    int row = 0;
    while (row < s->rows && s->sensors[row] != sensor)
      row++;
    if (row == s->rows && s->rows < MOST_ROWS)
      s->sensors[s->rows++] = sensor;
    steps += pags_view_begins_step(s->dataset, i);
  }
  const int columns = steps < COLUMNS ? (int)steps : COLUMNS;
  int column = 0;
  for (int64_t i = 0; i < count; i++) {
    step += pags_view_begins_step(s->dataset, i);
    const int sensor = pags_dataset_view(s->dataset, i)->sensor;
    while (column < columns - 1 && column * (steps - 1) / (columns - 1) < step)
      column++;
    for (int row = 0; row < s->rows; row++)
      if (s->sensors[row] == sensor && (columns < 2 || column * (steps - 1) / (columns - 1) == step)) {
        s->views[s->count] = i;
        s->row_of[s->count] = row;
        s->column_of[s->count++] = column;
      }
  }
}

static int cell_left(int column) {
  return MARGIN + column * (WIDTH - MARGIN) / COLUMNS;
}

/* A photograph is never enlarged. */
static int cell_width(const sheet *s, int cell) {
  const int column = s->column_of[cell], most = cell_left(column + 1) - cell_left(column) - GAP;
  const int width = pags_dataset_view(s->dataset, s->views[cell])->camera.width;
  return width < most ? width : most;
}

static int cell_height(const sheet *s, int cell) {
  const pags_camera *const camera = &pags_dataset_view(s->dataset, s->views[cell])->camera;
  const double height = (double)cell_width(s, cell) * camera->height / camera->width;
  return (int)fmin(fmax(height, 1), WIDTH / COLUMNS * 2);
}

/* ---- Drawing ---- */

/* Copies the photographs, shrunk to their cells' widths, with their numbers in the corners. */
static pags_result draw_photographs(const sheet *s, const pags_session *session) {
  PAGS_AUTO(pags_photo_cache_destroy_auto) pags_photo_cache *photos = NULL;
  PAGS_TRY(pags_photo_cache_create(s->dataset, session->tasks, (uint64_t)128 << 20, &photos));
  PAGS_AUTO(pags_progress_end) pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  for (int i = 0; i < s->count; i++) {
    pags_photo photo;
    PAGS_AUTO(pags_image_destroy) pags_image whole = {0}, small = {0};
    const int width = cell_width(s, i), height = cell_height(s, i);
    const int left = cell_left(s->column_of[i]), top = s->top[s->row_of[i]];
    if (pags_interrupted())
      return pags_fail(PAGS_CANCELLED, "interrupted after %d of %d photographs", i, s->count);
    PAGS_TRY(pags_photo_cache_get(photos, s->views[i], 1, &photo));
    PAGS_TRY(pags_photo_image(&photo, &whole));
    PAGS_TRY(pags_image_create(&small, width, height, 3, PAGS_U8));
    PAGS_TRY(
        pags_shrink_mean(&whole, fmax(1, (double)photo.width / width), fmax(1, (double)photo.height / height), &small));
    for (int y = 0; y < height; y++)
      memcpy((uint8_t *)s->image->data + 3 * ((size_t)(top + y) * WIDTH + (size_t)left),
             (const uint8_t *)small.data + 3 * (size_t)y * (size_t)width, 3 * (size_t)width);
    const int frame = pags_dataset_view(s->dataset, s->views[i])->frame;
    pags_draw_number(s->image, left, top, s->drive ? frame : s->views[i]);
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "photograph %d of %d", i + 1, s->count);
  }
  return PAGS_OK;
}

static const uint8_t path_colour[3] = {40, 90, 220}, held_colour[3] = {220, 40, 40}, cone_colour[3] = {20, 40, 120},
                     bar_colour[3] = {0, 0, 0}, parked_colour[3] = {150, 150, 150}, lidar_colour[3] = {165, 165, 165};
static const uint8_t category_colours[4][3] = {{120, 120, 120}, {0, 150, 150}, {200, 40, 200}, {200, 140, 0}};

static void centre_of(const pags_dataset *dataset, int64_t view, double out[3]) {
  pags_pose_position(pags_dataset_view(dataset, view)->camera.world_from_camera, out);
}

/* ---- The map: ground first, then boxes, the cameras on top ---- */

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

/* Fits the map, at most MOST_MAP pixels high, around the cameras. */
static void fit_map(sheet *s) {
  double low[2] = {HUGE_VAL, HUGE_VAL}, high[2] = {-HUGE_VAL, -HUGE_VAL};
  double forward[3];
  ground_axes(s->dataset, s->across, forward);
  pags_scale3(-1, forward, s->down);
  for (int64_t i = 0; i < pags_dataset_view_count(s->dataset); i++) {
    double c[3];
    centre_of(s->dataset, i, c);
    const double p[2] = {pags_dot3(c, s->across), pags_dot3(c, s->down)};
    for (int k = 0; k < 2; k++) {
      low[k] = fmin(low[k], p[k]);
      high[k] = fmax(high[k], p[k]);
    }
  }
  /* A drive has 25 m around it; a capture as much as it is wide. */
  const double way = fmax(high[0] - low[0], high[1] - low[1]);
  const double around = s->drive ? 25 : fmax(0.5 * way, 1e-3);
  const double size[2] = {high[0] - low[0] + 2 * around, high[1] - low[1] + 2 * around};
  s->scale = fmin(WIDTH / size[0], MOST_MAP / size[1]);
  s->map_height = (int)fmax(1, fmin(ceil(s->scale * size[1]), MOST_MAP));
  for (int k = 0; k < 2; k++)
    s->at[k] = 0.5 * (k ? s->map_height : WIDTH) - s->scale * 0.5 * (low[k] + high[k]);
}

static bool to_pixel(const sheet *s, const double world[3], double out[2]) {
  out[0] = s->scale * pags_dot3(world, s->across) + s->at[0];
  out[1] = s->scale * pags_dot3(world, s->down) + s->at[1];
  const bool inside = out[0] >= 0 && out[0] < WIDTH && out[1] >= 0 && out[1] < s->map_height;
  out[1] += s->top[s->rows];
  return inside;
}

static void draw_point(const sheet *s, const double world[3], int half, const uint8_t rgb[3]) {
  double at[2];
  if (to_pixel(s, world, at))
    pags_draw_dot(s->image, at[0], at[1], half, rgb);
}

/* Whether the time step `frame` is of one of the numbered views. */
static bool is_numbered(const sheet *s, int64_t frame) {
  for (int v = 0; v < s->count; v++)
    if (pags_dataset_view(s->dataset, s->views[v])->frame == frame)
      return true;
  return false;
}

/* Draws the sweeps of the numbered time steps or, where there is no LiDAR, the data set's points. */
static pags_result draw_ground(const sheet *s) {
  const int64_t sweeps = pags_dataset_sweep_count(s->dataset);
  double p[3], world[3];
  int64_t points;
  for (int64_t i = 0; i < sweeps; i++) {
    const pags_sweep *const sweep = pags_dataset_sweep(s->dataset, i);
    if (!is_numbered(s, sweep->frame))
      continue;
    PAGS_AUTOFREE float *xyz = NULL;
    PAGS_TRY(pags_dataset_sweep_load(s->dataset, i, &points, &xyz));
    for (int64_t k = 0; k < points; k++) {
      pags_widen3(xyz + 3 * k, p);
      pags_rigid_point(sweep->world_from_sweep, p, world);
      draw_point(s, world, 0, lidar_colour);
    }
  }
  const float *xyz;
  const uint8_t *rgb;
  int to_match;
  pags_dataset_points(s->dataset, &points, &xyz, &rgb, &to_match);
  if (sweeps > 0 || to_match)
    return PAGS_OK;
  for (int64_t i = 0; i < points; i++) {
    pags_widen3(xyz + 3 * i, p);
    pags_add3(p, pags_dataset_origin(s->dataset), world);
    draw_point(s, world, 0, rgb + 3 * i);
  }
  return PAGS_OK;
}

/* Draws the bases of the boxes, with a stroke from the middle to the front. */
static void draw_boxes(const sheet *s) {
  static const double corners[6][2] = {{0.5, 0.5}, {-0.5, 0.5}, {-0.5, -0.5}, {0.5, -0.5}, {0, 0}, {0.5, 0}};
  for (int64_t i = 0; i < pags_dataset_object_count(s->dataset); i++) {
    const pags_object *const object = pags_dataset_object(s->dataset, i);
    const uint8_t *const rgb = object->moving ? category_colours[object->category] : parked_colour;
    for (int v = 0; v < s->count; v++) {
      double pose[12], pixels[6][2];
      bool inside = true;
      if (!pags_object_pose(object, pags_dataset_view(s->dataset, s->views[v])->camera.time, pose))
        continue;
      for (int c = 0; c < 6; c++) {
        double world[3];
        for (int k = 0; k < 3; k++)
          world[k] = pose[4 * k] * corners[c][0] * object->size[0] + pose[4 * k + 1] * corners[c][1] * object->size[1] +
                     pose[4 * k + 3];
        inside = to_pixel(s, world, pixels[c]) && inside;
      }
      if (inside) {
        for (int c = 0; c < 4; c++)
          pags_draw_line(s->image, pixels[c], pixels[(c + 1) % 4], rgb);
        pags_draw_line(s->image, pixels[4], pixels[5], rgb);
      }
      if (!object->moving)
        break;
    }
  }
}

/* Draws a camera's edges of view, 30 pixels long, as they point on the ground. */
static void draw_cone(const sheet *s, const pags_camera *camera) {
  enum { LENGTH = 30 };
  double at[2], centre[3];
  pags_pose_position(camera->world_from_camera, centre);
  if (!to_pixel(s, centre, at))
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
    end[0] = pags_dot3(way, s->across);
    end[1] = pags_dot3(way, s->down);
    const double length = sqrt(end[0] * end[0] + end[1] * end[1]);
    for (int k = 0; k < 2; k++)
      end[k] = at[k] + (length > 0 ? LENGTH * end[k] / length : 0);
    if (end[0] >= 0 && end[0] < WIDTH && end[1] >= s->top[s->rows] && end[1] < s->top[s->rows] + s->map_height)
      pags_draw_line(s->image, at, end, cone_colour);
  }
}

static void draw_cameras(const sheet *s) {
  for (int v = 0; v < s->count; v++)
    draw_cone(s, &pags_dataset_view(s->dataset, s->views[v])->camera);
  for (int pass = 0; pass < 2; pass++) /* held-out ones on top */
    for (int64_t i = 0; i < pags_dataset_view_count(s->dataset); i++) {
      double centre[3];
      centre_of(s->dataset, i, centre);
      if ((pags_dataset_view(s->dataset, i)->test != 0) == pass)
        draw_point(s, centre, 1, pass ? held_colour : path_colour);
    }
  for (int v = 0; v < s->count; v++) {
    const pags_view *const view = pags_dataset_view(s->dataset, s->views[v]);
    double centre[3], at[2];
    centre_of(s->dataset, s->views[v], centre);
    const bool first =
        view->frame < 0 || v == 0 || pags_dataset_view(s->dataset, s->views[v - 1])->frame != view->frame;
    if (first && to_pixel(s, centre, at))
      pags_draw_number(s->image, (int)at[0] + 6, (int)at[1] + 6, view->frame < 0 ? s->views[v] : view->frame);
  }
}

/* Draws a bar of 1, 2 or 5 times a power of ten, a sixth of the map long at most, and its length if that is whole. */
static void draw_bar(const sheet *s) {
  const double most = WIDTH / 6.0 / s->scale, power = pags_pow(10, floor(pags_log10(most)));
  const double length = power * (most >= 5 * power ? 5 : most >= 2 * power ? 2 : 1);
  const double y = s->top[s->rows] + s->map_height - 12, a[2] = {12, y}, b[2] = {12 + length * s->scale, y};
  pags_draw_line(s->image, a, b, bar_colour);
  pags_draw_line(s->image, (double[]){a[0], y - 6}, a, bar_colour);
  pags_draw_line(s->image, (double[]){b[0], y - 6}, b, bar_colour);
  if (length >= 1)
    pags_draw_number(s->image, 18, (int)y - 18, (int64_t)(length + 0.5));
}

/* ---- The sheet ---- */

pags_result pags_sheet(const pags_dataset *dataset, const char *file, const pags_session *session,
                       pags_report *report) {
  sheet s = {.dataset = dataset, .drive = pags_dataset_fps(dataset) > 0};
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  if (s.drive) {
    choose_drive(&s);
  } else {
    const int64_t count = pags_dataset_view_count(dataset);
    s.count = (int)(count < STATIC_ROWS * COLUMNS ? count : STATIC_ROWS * COLUMNS);
    s.rows = (s.count + COLUMNS - 1) / COLUMNS;
    for (int i = 0; i < s.count; i++) {
      s.views[i] = i * count / s.count;
      s.row_of[i] = i / COLUMNS;
      s.column_of[i] = i % COLUMNS;
    }
  }
  for (int row = 0; row < s.rows; row++) {
    int height = 0;
    for (int i = 0; i < s.count; i++)
      if (s.row_of[i] == row && cell_height(&s, i) > height)
        height = cell_height(&s, i);
    s.top[row + 1] = s.top[row] + height + GAP;
  }
  fit_map(&s);
  PAGS_TRY(pags_image_create(&image, WIDTH, s.top[s.rows] + s.map_height, 3, PAGS_U8));
  memset(image.data, 255, (size_t)3 * WIDTH * (size_t)image.height);
  for (int row = 0; s.drive && row < s.rows; row++)
    pags_draw_number(&image, 4, s.top[row], s.sensors[row]);
  s.image = &image;
  PAGS_TRY(draw_photographs(&s, session));
  PAGS_TRY(draw_ground(&s));
  draw_boxes(&s);
  draw_cameras(&s);
  draw_bar(&s);
  PAGS_TRY(pags_image_save(file, &image));

  pags_report_begin_group(report, "sheet");
  pags_report_text(report, "file", file);
  pags_report_begin_list(report, s.drive ? "cameras" : "views");
  for (int i = 0; i < (s.drive ? s.rows : s.count); i++) {
    char line[640];
    if (s.drive)
      snprintf(line, sizeof line, "%d: %s", s.sensors[i], pags_dataset_sensor_name(dataset, s.sensors[i]));
    else
      snprintf(line, sizeof line, "%lld: %s", (long long)s.views[i], pags_dataset_view(dataset, s.views[i])->name);
    pags_report_sentence(report, line);
  }
  pags_report_end_list(report);
  pags_report_end_group(report);
  return PAGS_OK;
}
