/* SPDX-License-Identifier: Apache-2.0 */
/* Computes, for a photograph with lens distortion, a pinhole camera that covers the photograph's field of view and
 * the map from its pixels to pinhole pixels: masks are drawn with the pinhole camera and looked up for each pixel of
 * the photograph. Converts Waymo's panoptic labels to semantic masks and sky masks (waymo_masks.h). */
#include "import/waymo_masks.h"

#include <math.h>
#include <stdio.h>

#include <pags/image.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "scene/lens.h"

/* ---- Lenses ---- */

typedef struct bounds {
  double x0, x1, y0, y1; /* rectangle on the plane z = 1 */
} bounds;

static void include_pixel(const pags_lens *lens, double u, double v, bounds *b) {
  double x, y;
  if (!pags_lens_unproject(lens, u, v, &x, &y))
    return;
  b->x0 = fmin(b->x0, x);
  b->x1 = fmax(b->x1, x);
  b->y0 = fmin(b->y0, y);
  b->y1 = fmax(b->y1, y);
}

/* Returns the bounds on the plane z = 1 of what the photograph shows, from its border. The bounds contain the field
 * of view without distortion and exceed it on each side by at most half its extent, because the distortion polynomial
 * stretches without bound at the end of its range. */
static bounds seen_bounds(const pags_lens *lens) {
  const double w = lens->width, h = lens->height;
  bounds b = {INFINITY, -INFINITY, INFINITY, -INFINITY};
  for (int i = 0; i <= lens->width; i++) {
    include_pixel(lens, i, 0, &b);
    include_pixel(lens, i, h, &b);
  }
  for (int i = 0; i <= lens->height; i++) {
    include_pixel(lens, 0, i, &b);
    include_pixel(lens, w, i, &b);
  }
  const bounds flat = {-lens->cx / lens->fx, (w - lens->cx) / lens->fx, -lens->cy / lens->fy,
                       (h - lens->cy) / lens->fy};
  const double wide = flat.x1 - flat.x0, high = flat.y1 - flat.y0;
  b.x0 = fmax(fmin(b.x0, flat.x0), flat.x0 - wide / 2);
  b.x1 = fmin(fmax(b.x1, flat.x1), flat.x1 + wide / 2);
  b.y0 = fmax(fmin(b.y0, flat.y0), flat.y0 - high / 2);
  b.y1 = fmin(fmax(b.y1, flat.y1), flat.y1 + high / 2);
  return b;
}

/* Unprojecting a pixel takes a microsecond, so that it is done only at the corner of every STEP-th pixel and
 * interpolated bilinearly between. The second derivative of the inverse is below 1e-4 / px for Waymo's lenses, which
 * makes the error less than a thousandth of a pixel. */
enum { STEP = 8 };

typedef struct map_job {
  const pags_lens *lens;
  const pags_camera *pinhole;
  int columns;     /* columns of the lattice */
  double *lattice; /* x and y of the lattice's points on the plane z = 1; NaN where the lens can't be inverted */
  int32_t *source;
} map_job;

static void map_lattice(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const map_job *job = context;
  for (int64_t i = begin; i < end; i++) {
    double *xy = job->lattice + 2 * i;
    const double u = (double)(STEP * (i % job->columns)), v = (double)(STEP * (i / job->columns));
    if (!pags_lens_unproject(job->lens, u, v, &xy[0], &xy[1]))
      xy[0] = xy[1] = (double)NAN;
  }
}

static void map_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const map_job *job = context;
  const pags_camera *p = job->pinhole;
  for (int64_t v = begin; v < end; v++)
    for (int u = 0; u < job->lens->width; u++) {
      const double *a = job->lattice + 2 * (v / STEP * job->columns + u / STEP), *b = a + (ptrdiff_t)2 * job->columns;
      const double s = (u % STEP + 0.5) / STEP, t = ((double)(v % STEP) + 0.5) / STEP;
      const double x = (1 - t) * ((1 - s) * a[0] + s * a[2]) + t * ((1 - s) * b[0] + s * b[2]);
      const double y = (1 - t) * ((1 - s) * a[1] + s * a[3]) + t * ((1 - s) * b[1] + s * b[3]);
      const double column = floor(p->cx + x * p->fx), row = floor(p->cy + y * p->fy);
      const int seen = column >= 0 && column < p->width && row >= 0 && row < p->height; /* false for NaN */
      job->source[v * job->lens->width + u] = seen ? (int32_t)row * p->width + (int32_t)column : -1;
    }
}

static pags_result map_pixels(const pags_lens *lens, const char *where, pags_tasks *tasks, pags_waymo_lens *out) {
  const bounds b = seen_bounds(lens);
  const size_t pixels = (size_t)lens->width * (size_t)lens->height;
  const int columns = (lens->width + STEP - 1) / STEP + 1, rows = (lens->height + STEP - 1) / STEP + 1;
  pags_camera *c = &out->pinhole;
  c->cx = ceil(-b.x0 * lens->fx);
  c->cy = ceil(-b.y0 * lens->fy);
  c->width = (int)fmin(fmax(ceil(c->cx + b.x1 * lens->fx), 1), 65535);
  c->height = (int)fmin(fmax(ceil(c->cy + b.y1 * lens->fy), 1), 65535);
  if ((int64_t)c->width * c->height > INT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: photographs of %d x %d pixels are too large", where, lens->width,
                     lens->height);
  out->source = malloc(pixels * sizeof *out->source);
  PAGS_AUTOFREE double *lattice = malloc((size_t)columns * (size_t)rows * 2 * sizeof *lattice);
  out->lens = (pags_layout_lens){.width = lens->width, .height = lens->height, .source = out->source};
  map_job job = {.lens = lens, .pinhole = c, .columns = columns, .lattice = lattice, .source = out->source};
  PAGS_CHECK_MEMORY(out->source && lattice, "%s", where);
  PAGS_TRY(pags_parallel_run(tasks, (int64_t)columns * rows, columns, map_lattice, &job));
  return pags_parallel_run(tasks, lens->height, 16, map_rows, &job);
}

pags_result pags_waymo_lens_make(const pags_layout_camera *camera, const char *where, pags_tasks *tasks,
                                 pags_waymo_lens *out) {
  const double *k = camera->intrinsics;
  pags_lens lens = {.model.kind = PAGS_LENS_PERSPECTIVE,
                    .width = camera->width,
                    .height = camera->height,
                    .fx = k[0],
                    .fy = k[1],
                    .cx = k[2],
                    .cy = k[3],
                    .model.k = {k[4], k[5], k[8], 0},
                    .model.p = {k[6], k[7]}};
  PAGS_TRY(pags_lens_prepare(&lens, where));
  out->pinhole = (pags_camera){.width = lens.width,
                               .height = lens.height,
                               .fx = lens.fx,
                               .fy = lens.fy,
                               .cx = lens.cx,
                               .cy = lens.cy,
                               .time = (double)NAN};
  return pags_lens_is_pinhole(&lens) ? PAGS_OK : map_pixels(&lens, where, tasks, out);
}

void pags_waymo_lens_destroy(pags_waymo_lens *lens) {
  free(lens->source);
  *lens = (pags_waymo_lens){0};
}

/* ---- Panoptic labels ---- */

enum { UNKNOWN = 255, SKY = 10 };

uint8_t pags_waymo_train_id(int waymo_class) {
  static const uint8_t ids[] = {UNKNOWN, UNKNOWN, 13,      14,      15,      14, 18,      17,      14,     11,
                                12,      12,      UNKNOWN, UNKNOWN, UNKNOWN, 5,  11,      7,       6,      2,
                                0,       0,       0,       1,       8,       10, UNKNOWN, UNKNOWN, UNKNOWN};
  return waymo_class >= 0 && waymo_class < (int)sizeof ids ? ids[waymo_class] : UNKNOWN;
}

pags_result pags_waymo_put_semantic(const pags_layout *layout, const Pags__Waymo__CameraImage *image, int64_t frame,
                                    const pags_layout_camera *camera, const char *where, bool *labelled) {
  const Pags__Waymo__CameraSegmentationLabel *label = image->camera_segmentation_label;
  const int number = camera->number;
  *labelled = label && label->panoptic_label.len;
  if (!*labelled || (pags_layout_has(layout, "semantic", frame, number, ".png") &&
                     pags_layout_has(layout, "sky_masks", frame, number, ".png")))
    return PAGS_OK;
  if (label->panoptic_label_divisor < 1)
    return pags_fail_at(where, "panoptic label of camera %d: divisor %d, expected at least 1", number,
                        label->panoptic_label_divisor);
  PAGS_TRY(pags_layout_put_file(layout, "panoptic", frame, number, ".png", label->panoptic_label.data,
                                label->panoptic_label.len));
  PAGS_AUTO(pags_image_destroy) pags_image panoptic = {0};
  char name[64];
  snprintf(name, sizeof name, "panoptic/%03lld_%d.png", (long long)frame, number);
  PAGS_AUTOFREE char *path = pags_path_join(layout->folder, name);
  PAGS_CHECK_MEMORY(path, "%s", layout->folder);
  PAGS_TRY(pags_image_load(path, PAGS_U16, 1, &panoptic));
  const int width = panoptic.width, height = panoptic.height;
  if (width != camera->width || height != camera->height)
    return pags_fail_at(where, "panoptic label of camera %d: %d x %d pixels, expected %d x %d", number, width, height,
                        camera->width, camera->height);
  const size_t pixels = (size_t)width * (size_t)height;
  const uint16_t *labels = panoptic.data;
  PAGS_AUTOFREE uint8_t *plane = malloc(pixels);
  PAGS_CHECK_MEMORY(plane, "%s: a mask", layout->folder);
  for (size_t i = 0; i < pixels; i++)
    plane[i] = pags_waymo_train_id(labels[i] / label->panoptic_label_divisor);
  PAGS_TRY(pags_layout_put_mask(layout, "semantic", frame, number, width, height, plane));
  for (size_t i = 0; i < pixels; i++)
    plane[i] = plane[i] == SKY ? 255 : 0;
  return pags_layout_put_mask(layout, "sky_masks", frame, number, width, height, plane);
}
