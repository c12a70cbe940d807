/* SPDX-License-Identifier: Apache-2.0 */
/* Lays out and draws the sheet of a data set (info.h): choose the views, place their cells, fill them, add the map. */
#include "cli/measure/info.h"

#include "cli/common/progress.h"
#include "cli/measure/overlay_draw.h"

#include <math.h>
#include <stdio.h>
#include "dataset/owners.h"
#include "image/pixels.h"

enum { WIDTH = 1600, COLUMNS = 8, MOST_ROWS = 12, STATIC_ROWS = 4, MARGIN = 36, GAP = 4, MOST_MAP = 1000 };

typedef struct sheet {
  const pags_dataset *dataset;
  bool drive;
  int rows, count; /* of cells: count is at most rows * COLUMNS */
  int64_t views[MOST_ROWS * COLUMNS];
  int row_of[MOST_ROWS * COLUMNS], column_of[MOST_ROWS * COLUMNS];
  int sensors[MOST_ROWS]; /* of a drive, by row */
  int top[MOST_ROWS + 1]; /* pixel rows at which rows of cells begin; the last: where the map does */
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
static pags_result draw_photographs(const sheet *s, const pags_session *session, pags_image *image) {
  PAGS_AUTO(pags_photo_cache_destroy_auto) pags_photo_cache *photos = NULL;
  PAGS_TRY(pags_photo_cache_create(s->dataset, session->tasks, (uint64_t)128 << 20, &photos));
  PAGS_AUTO(pags_progress_end) pags_progress progress = pags_progress_begin(session->people);
  pags_interrupt_install(session->tasks);
  for (int i = 0; i < s->count; i++) {
    pags_photo photo;
    PAGS_AUTO(pags_image_destroy) pags_image whole = {0};
    PAGS_AUTO(pags_image_destroy) pags_image small = {0};
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
      memcpy((uint8_t *)image->data + 3 * ((size_t)(top + y) * WIDTH + (size_t)left),
             (const uint8_t *)small.data + 3 * (size_t)y * (size_t)width, 3 * (size_t)width);
    const int frame = pags_dataset_view(s->dataset, s->views[i])->frame;
    pags_draw_number(image, left, top, s->drive ? frame : s->views[i]);
    if (pags_progress_due(&progress))
      pags_progress_show(&progress, "photograph %d of %d", i + 1, s->count);
  }
  return PAGS_OK;
}

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
  const pags_map map = pags_map_fit(dataset, WIDTH, MOST_MAP);
  PAGS_TRY(pags_image_create(&image, WIDTH, s.top[s.rows] + map.height, 3, PAGS_U8));
  memset(image.data, 255, (size_t)3 * WIDTH * (size_t)image.height);
  for (int row = 0; s.drive && row < s.rows; row++)
    pags_draw_number(&image, 4, s.top[row], s.sensors[row]);
  PAGS_TRY(draw_photographs(&s, session, &image));
  PAGS_TRY(pags_map_draw(&map, dataset, s.views, s.count, &image, s.top[s.rows]));
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
