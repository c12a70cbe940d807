/* SPDX-License-Identifier: Apache-2.0 */
/* Computes, for a photograph with lens distortion, a pinhole camera that covers the photograph's field of view and
 * the map from its pixels to pinhole pixels: masks are drawn with the pinhole camera and looked up for each pixel of
 * the photograph (waymo_masks.h). */
#include "import/waymo_masks.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "scene/lens.h"

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

static pags_camera pinhole_of(const pags_lens *lens, const bounds *b) {
  pags_camera c = {.fx = lens->fx, .fy = lens->fy, .time = (double)NAN};
  c.cx = ceil(-b->x0 * lens->fx);
  c.cy = ceil(-b->y0 * lens->fy);
  c.width = (int)fmin(fmax(ceil(c.cx + b->x1 * lens->fx), 1), 65535);
  c.height = (int)fmin(fmax(ceil(c.cy + b->y1 * lens->fy), 1), 65535);
  return c;
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

static void map_lattice(void *context, int64_t begin, int64_t end, int worker) {
  const map_job *job = context;
  (void)worker;
  for (int64_t i = begin; i < end; i++) {
    double *xy = job->lattice + 2 * i;
    const double u = (double)(STEP * (i % job->columns)), v = (double)(STEP * (i / job->columns));
    if (!pags_lens_unproject(job->lens, u, v, &xy[0], &xy[1]))
      xy[0] = xy[1] = (double)NAN;
  }
}

static void map_rows(void *context, int64_t begin, int64_t end, int worker) {
  const map_job *job = context;
  const pags_camera *p = job->pinhole;
  (void)worker;
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
  out->pinhole = pinhole_of(lens, &b);
  if ((int64_t)out->pinhole.width * out->pinhole.height > INT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: photographs of %d x %d pixels are too large", where, lens->width,
                     lens->height);
  out->source = malloc(pixels * sizeof *out->source);
  double *lattice = malloc((size_t)columns * (size_t)rows * 2 * sizeof *lattice);
  out->lens = (pags_layout_lens){.width = lens->width, .height = lens->height, .source = out->source};
  map_job job = {.lens = lens, .pinhole = &out->pinhole, .columns = columns, .lattice = lattice, .source = out->source};
  pags_result result = PAGS_OK;
  if (!out->source || !lattice)
    result = pags_out_of_memory("%s", where);
  else if (!pags_parallel_for(tasks, (int64_t)columns * rows, columns, map_lattice, &job) ||
           !pags_parallel_for(tasks, lens->height, 16, map_rows, &job))
    result = pags_fail(PAGS_CANCELLED, "cancelled");
  free(lattice);
  return result;
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
  *out = (pags_waymo_lens){0};
  PAGS_TRY(pags_lens_prepare(&lens, where));
  if (!pags_lens_is_pinhole(&lens)) {
    const pags_result result = map_pixels(&lens, where, tasks, out);
    if (result != PAGS_OK)
      pags_waymo_lens_destroy(out);
    return result;
  }
  out->pinhole = (pags_camera){.width = lens.width,
                               .height = lens.height,
                               .fx = lens.fx,
                               .fy = lens.fy,
                               .cx = lens.cx,
                               .cy = lens.cy,
                               .time = (double)NAN};
  return PAGS_OK;
}

void pags_waymo_lens_destroy(pags_waymo_lens *lens) {
  free(lens->source);
  *lens = (pags_waymo_lens){0};
}
