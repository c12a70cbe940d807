/* SPDX-License-Identifier: Apache-2.0 */
/* Chooses the camera of a view's photographs, and masks what its lens doesn't see.
 *
 * Whatever is seen lies within the image of the circle at the lens's widest angle from its axis, a smooth closed curve
 * around the principal point; a polygon of it is a thousandth of a pixel off. */
#include "dataset/internal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "maths/maths.h"
#include "scene/lens.h"

#define PI 3.14159265358979323846

/* A lens is kept if the pinhole would lose more than this of what it sees. */
static const double most_lost = 0.1;

static bool same_lens(const pags_lens *a, const pags_lens *b) {
  const pags_lens_model *const m = &a->model, *const n = &b->model;
  return m->kind == n->kind && a->width == b->width && a->height == b->height && a->fx == b->fx && a->fy == b->fy &&
         a->cx == b->cx && a->cy == b->cy && memcmp(m->k, n->k, sizeof m->k) == 0 &&
         memcmp(m->d, n->d, sizeof m->d) == 0 && memcmp(m->p, n->p, sizeof m->p) == 0 &&
         memcmp(m->s, n->s, sizeof m->s) == 0 && m->field == n->field;
}

/* Compares a grid of the lens's pixels with what the pinhole shows. *unseen: the share of the picture that the lens
 * doesn't see; returns the share of the rest that the pinhole loses. */
static double lost_share(const pags_camera *lens, const pags_camera *pinhole, double *unseen) {
  enum { GRID = 64 };
  int seen = 0, kept = 0;
  for (int j = 0; j < GRID; j++)
    for (int i = 0; i < GRID; i++) {
      double direction[3], pixel[2];
      if (!pags_camera_look(lens, (i + 0.5) / GRID * lens->width, (j + 0.5) / GRID * lens->height, direction))
        continue;
      seen++;
      kept += pags_camera_project(pinhole, direction, pixel, NULL) && pixel[0] >= 0 && pixel[0] <= pinhole->width &&
              pixel[1] >= 0 && pixel[1] <= pinhole->height;
    }
  *unseen = 1 - (double)seen / (GRID * GRID);
  return seen ? 1 - (double)kept / seen : 0;
}

/* Finding a pinhole costs milliseconds, so the camera of an earlier view with an identical lens is copied instead. */
pags_result pags_view_camera_choose(pags_dataset *dataset, int64_t index, bool undistort, double *share) {
  pags_parsed_view *views = dataset->parsed.views;
  pags_lens *const lens = &views[index].lens;
  pags_camera *const out = &dataset->cameras[index];
  const char *const where = views[index].where;
  *share = 0;
  for (int64_t i = 0; i < index; i++)
    if (same_lens(&views[i].lens, lens)) {
      *lens = views[i].lens;
      *out = dataset->cameras[i];
      return PAGS_OK;
    }
  PAGS_TRY(pags_lens_prepare(lens, where));
  if (!(lens->model.field > 0)) /* else the field states how far it is right */
    PAGS_TRY(pags_lens_check_inverse(lens, where, share));
  if (undistort || pags_lens_is_pinhole(lens))
    return pags_lens_pinhole(lens, where, out);
  const pags_camera own = {.width = lens->width,
                           .height = lens->height,
                           .fx = lens->fx,
                           .fy = lens->fy,
                           .cx = lens->cx,
                           .cy = lens->cy,
                           .lens = lens->model};
  double unseen;
  const pags_result result = pags_lens_pinhole(lens, where, out);
  const bool turns = pags_lens_is_of_angle(lens->model.kind) || lens->model.kind == PAGS_LENS_EQUIRECTANGULAR;
  if (result == PAGS_OK && lost_share(&own, out, &unseen) < most_lost)
    return PAGS_OK;
  /* A lens of r of which a pinhole leaves next to nothing has wrong numbers, as dataset.c says then. */
  if (!turns && (result != PAGS_OK || out->width < 0.1 * lens->width))
    return result;
  if (result != PAGS_OK && result != PAGS_ERROR_FORMAT)
    return result;
  lost_share(&own, &own, &unseen);
  *share = lens->model.field > 0 ? 0 : fmax(*share, unseen);
  *out = own;
  return PAGS_OK;
}

/* ---- What a lens doesn't see ---- */

/* Marks in `seen` the pixels within the circle at the lens's widest angle, a pixel nearer to the middle. */
static void mark_circle(const pags_camera *camera, uint8_t *seen) {
  enum { POINTS = 1440 };
  const double widest = 0.999 * pags_lens_model_widest(&camera->lens);
  double corners[2 * POINTS];
  for (int i = 0; i < POINTS; i++) {
    const double turn = 2 * PI * i / POINTS, across = pags_sin(widest);
    const double direction[3] = {across * pags_cos(turn), across * pags_sin(turn), pags_cos(widest)};
    double at[2];
    pags_lens_see(&camera->lens, direction, at, NULL);
    const double x = camera->fx * at[0], y = camera->fy * at[1], r = pags_hypot(x, y), nearer = fmax(1 - 1 / r, 0);
    corners[2 * i] = camera->cx + nearer * x;
    corners[2 * i + 1] = camera->cy + nearer * y;
  }
  pags_outline_fill(corners, POINTS, camera->width, camera->height, camera->width, 255, seen);
}

pags_result pags_view_camera_mask(const pags_camera *camera, pags_image *mask) {
  const size_t pixels = (size_t)camera->width * (size_t)camera->height;
  if (!pags_camera_bends(camera))
    return PAGS_OK;
  PAGS_AUTOFREE uint8_t *seen = calloc(pixels, 1);
  PAGS_CHECK_MEMORY(seen, "a mask of %d x %d pixels", camera->width, camera->height);
  if (camera->lens.kind == PAGS_LENS_EQUIRECTANGULAR) {
    for (int y = 0; y < camera->height; y++)
      for (int x = 0; x < camera->width; x++) {
        double direction[3];
        seen[(size_t)y * (size_t)camera->width + (size_t)x] =
            pags_camera_look(camera, x + 0.5, y + 0.5, direction) ? 255 : 0;
      }
  } else {
    mark_circle(camera, seen);
  }
  if (!mask->data && memchr(seen, 0, pixels)) {
    PAGS_TRY(pags_image_create(mask, camera->width, camera->height, 1, PAGS_U8));
    memset(mask->data, 255, pixels);
  }
  uint8_t *const used = mask->data;
  for (size_t i = 0; used && i < pixels; i++)
    used[i] &= seen[i];
  return PAGS_OK;
}
