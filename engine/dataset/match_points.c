/* SPDX-License-Identifier: Apache-2.0 */
/* Computes initial points for training from the photographs themselves, by plane-sweep stereo.
 *
 * From random points, training has to move everything into place, and a short run never gets back the quality that
 * this costs (on data/fox 4 dB after 1,000 steps at a quarter of the size, compared with the points of a
 * structure-from-motion model). The poses are known, so depth is cheap to find: a small patch around a random pixel
 * of a training photograph is projected, for each of many depths along the pixel's ray, into a few other training
 * photographs, and the depth with the highest correlation is taken (plane sweep: Collins, "A space-sweep approach to
 * true multi-image matching", CVPR 1996; patches and the choice of views as in multi-view stereo). A pixel without a
 * clear depth (bare walls, sky) takes the depth of the nearest pixel of the same photograph that has one.
 *
 * The photographs are matched at 160 to 320 pixels on the longer side; a ray costs some 8,000 samples. Each ray has
 * its own random numbers and doesn't depend on other rays, so that the result doesn't depend on the number of
 * threads. */
#include "dataset/internal.h"

#include "base/log.h"
#include "base/memory.h"
#include "base/parallel.h"
#include "base/rng.h"
#include "base/vec3.h"
#include "dataset/parsed.h"
#include "maths/maths.h"
#include "port/port.h"

#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
  MOST_PICTURES = 256, /* most photographs matched; from a larger set every nth training view is taken */
  SMALL_SIDE = 320,    /* longest side of a matched photograph, pixels */
  NEIGHBOURS = 4,      /* photographs that a patch is compared with */
  TRIES = 16,          /* draws of a pixel that the mask allows */
  DEPTHS = 96,         /* depths tested for a ray */
  RADIUS = 2,          /* of a patch, pixels */
  TAPS = (2 * RADIUS + 1) * (2 * RADIUS + 1)
};

/* Range of the depths tested, as multiples of the distance of the subject; the depths are evenly spaced in 1 / depth,
 * like disparities. */
static const double nearest = 0.3, farthest = 6.0;

/* Least mean correlation, over the better half of the neighbours, at which a depth is accepted. */
static const double sure_score = 0.85;

/* Standard deviation of a patch's grey values (0..255) below which the patch is mostly noise and is not matched. */
static const double flat = 2.0;

/* Random number stream of this file, so that other users of the same seed draw independent numbers. */
#define STREAM UINT64_C(0x6d61746368000000)

typedef struct picture {
  pags_camera camera; /* of the photograph at matching size */
  int width, height;
  uint8_t *rgb; /* interleaved R, G, B */
  float *grey;
  uint8_t *mask;              /* NULL: every pixel counts */
  int neighbours[NEIGHBOURS]; /* indices of the best partners in `pictures`, best first; -1: none */
} picture;

typedef struct ray {
  int picture;
  double u, v;    /* pixels */
  double inverse; /* 1 / depth, if sure */
  bool sure;      /* a depth was accepted */
} ray;

typedef struct matcher {
  const pags_dataset *dataset;
  uint64_t seed;
  double distance; /* of the subject (pags_focus_distance) */
  int count;
  int64_t *views;
  picture *pictures;
  int64_t ray_count;
  ray *rays;
  float *xyz; /* output: one point per ray */
  uint8_t *rgb;
} matcher;

/* ---- Loading the photographs ---- */

/* Copies a decoded photograph into a picture: interleaved colours for the colours of the points, grey values (weights
 * 1:2:1 of R, G, B) for matching, and the mask. */
static pags_result keep_photo(const pags_photo_data *photo, picture *p) {
  size_t pixels = (size_t)photo->width * (size_t)photo->height, plane = (size_t)photo->stride * (size_t)photo->height;
  p->width = photo->width;
  p->height = photo->height;
  p->rgb = malloc(pixels * 3);
  p->grey = malloc(pixels * sizeof *p->grey);
  p->mask = photo->has_mask ? malloc(pixels) : NULL;
  PAGS_CHECK_MEMORY(p->rgb && p->grey && (p->mask || !photo->has_mask), "points from photographs");
  for (size_t y = 0; y < (size_t)photo->height; y++)
    for (size_t x = 0; x < (size_t)photo->width; x++) {
      size_t to = y * (size_t)photo->width + x, from = y * (size_t)photo->stride + x;
      for (size_t c = 0; c < 3; c++)
        p->rgb[3 * to + c] = photo->planes[c * plane + from];
      if (p->mask)
        p->mask[to] = photo->planes[3 * plane + from];
      p->grey[to] = (float)(p->rgb[3 * to] + 2 * p->rgb[3 * to + 1] + p->rgb[3 * to + 2]) / 4;
    }
  return PAGS_OK;
}

/* Resamples a photograph that keeps its lens to a pinhole of the same focal lengths and size, since patches are warped
 * between pinholes: the middle of what the lens sees. */
static pags_result straighten(picture *p) {
  const pags_camera from = p->camera;
  const size_t pixels = (size_t)p->width * (size_t)p->height;
  PAGS_AUTOFREE uint8_t *rgb = calloc(pixels, 3);
  PAGS_AUTOFREE uint8_t *mask = calloc(pixels, 1);
  PAGS_CHECK_MEMORY(rgb && mask, "points from photographs");
  p->camera.lens = (pags_lens_model){0};
  for (int y = 0; y < p->height; y++)
    for (int x = 0; x < p->width; x++) {
      const size_t to = (size_t)y * (size_t)p->width + (size_t)x;
      double way[3], at[2];
      pags_camera_look(&p->camera, x + 0.5, y + 0.5, way);
      if (!pags_camera_project(&from, way, at, NULL) || !(at[0] >= 0.5 && at[1] >= 0.5) ||
          !(at[0] < p->width - 0.501 && at[1] < p->height - 0.501))
        continue;
      const int left = (int)(at[0] - 0.5), top = (int)(at[1] - 0.5);
      const double across = at[0] - 0.5 - left, down = at[1] - 0.5 - top;
      const size_t a = (size_t)top * (size_t)p->width + (size_t)left, c = a + (size_t)p->width;
      double sum[3];
      for (size_t k = 0; k < 3; k++) {
        const double upper = p->rgb[3 * a + k] + across * (p->rgb[3 * a + 3 + k] - p->rgb[3 * a + k]);
        const double lower = p->rgb[3 * c + k] + across * (p->rgb[3 * c + 3 + k] - p->rgb[3 * c + k]);
        sum[k] = upper + down * (lower - upper);
        rgb[3 * to + k] = (uint8_t)(sum[k] + 0.5);
      }
      p->grey[to] = (float)((sum[0] + 2 * sum[1] + sum[2]) / 4);
      mask[to] = !p->mask || (p->mask[a] && p->mask[a + 1] && p->mask[c] && p->mask[c + 1]) ? 255 : 0;
    }
  free(p->rgb);
  free(p->mask);
  p->rgb = pags_take(&rgb);
  p->mask = pags_take(&mask);
  return PAGS_OK;
}

static pags_result load_picture(void *context, int64_t index, PAGS_UNUSED int worker) {
  const matcher *m = context;
  const pags_dataset *dataset = m->dataset;
  picture *out = &m->pictures[index];
  const int64_t view = m->views[index];
  const pags_camera *camera = &dataset->views[view].camera;
  int side = camera->width > camera->height ? camera->width : camera->height, shrink = 1;
  while (side / shrink > SMALL_SIDE)
    shrink *= 2;
  out->camera = pags_camera_downscale(camera, shrink);
  PAGS_AUTO(pags_photo_data_destroy) pags_photo_data photo = {0};
  PAGS_TRY(pags_photo_decode(dataset, view, shrink, &photo));
  PAGS_TRY(keep_photo(&photo, out));
  return pags_camera_bends(camera) ? straighten(out) : PAGS_OK;
}

/* ---- Geometry and the choice of partners ---- */

static void point_on_ray(const pags_camera *camera, double u, double v, double depth, double point[3]) {
  const double own[3] = {(u - camera->cx) / camera->fx * depth, (v - camera->cy) / camera->fy * depth, depth};
  pags_rigid_point(camera->world_from_camera, own, point);
}

/* Returns the cost of matching picture `a` with picture `b`; smaller is better, infinity means that `b` is of no use.
 * The cost is |log(angle / 10 degrees)| of the angle between the two cameras as seen from the subject: ten degrees
 * are wide enough to distinguish depths and narrow enough for the patches to look alike. */
static double partner_cost(const matcher *m, const picture *a, const picture *b) {
  double point[3];
  point_on_ray(&a->camera, 0.5 * a->width, 0.5 * a->height, m->distance, point);
  double p[3], q[3]; /* from the point to the cameras */
  pags_pose_position(a->camera.world_from_camera, p);
  pags_pose_position(b->camera.world_from_camera, q);
  pags_add_scaled3(-1, point, p);
  pags_add_scaled3(-1, point, q);
  const double cosine = pags_dot3(p, q) / sqrt(pags_dot3(p, p) * pags_dot3(q, q));
  const double angle = pags_acos(fmax(-1, fmin(1, cosine))) * 180 / 3.14159265358979323846;
  if (!(angle > 1.5 && angle < 40) || !pags_camera_sees(&b->camera, point, 0.1 * m->distance))
    return INFINITY;
  return fabs(pags_log(angle / 10));
}

/* ---- Matching a ray ---- */

/* An affinely warped patch of a photograph: tap (i, j) lies at (u + a i + b j, v + c i + d j). */
typedef struct patch {
  double u, v, a, b, c, d;
} patch;

static bool inside(const picture *p, const patch *q) {
  double du = RADIUS * (fabs(q->a) + fabs(q->b)), dv = RADIUS * (fabs(q->c) + fabs(q->d));
  return q->u - du >= 0.5 && q->v - dv >= 0.5 && q->u + du < p->width - 0.501 && q->v + dv < p->height - 0.501;
}

/* Samples the grey values of a patch bilinearly, subtracts their mean and divides by their norm, so that the dot
 * product of two patches is their normalised cross-correlation. Returns false if the patch is flat. */
static bool normalised_taps(const picture *p, const patch *q, float taps[TAPS]) {
  float sum = 0, square = 0;
  int n = 0;
  for (int j = -RADIUS; j <= RADIUS; j++)
    for (int i = -RADIUS; i <= RADIUS; i++) {
      double u = q->u + q->a * i + q->b * j;
      double v = q->v + q->c * i + q->d * j;
      double x = u - 0.5, y = v - 0.5;
      int ix = (int)x, iy = (int)y;
      float fx = (float)(x - ix), fy = (float)(y - iy);
      const float *at = p->grey + (size_t)iy * (size_t)p->width + ix;
      float top = at[0] + fx * (at[1] - at[0]), bottom = at[p->width] + fx * (at[p->width + 1] - at[p->width]);
      taps[n] = top + fy * (bottom - top);

      sum += taps[n++];
    }
  for (n = 0; n < TAPS; n++) {
    taps[n] -= sum / TAPS;
    square += taps[n] * taps[n];
  }
  if (!(square > (float)(flat * flat * TAPS)))
    return false;
  float scale = 1 / sqrtf(square);
  for (n = 0; n < TAPS; n++)
    taps[n] *= scale;
  return true;
}

/* Projects a patch of picture `from`, centred at pixel (u, v), parallel to its image plane and at depth 1 / inverse,
 * into picture `to`; m is to_camera_from_from_camera. The centre is projected exactly, the axes of the patch by the
 * derivative of the projection. Returns false if the patch leaves the photograph or changes its area by more than a
 * factor of 4. */
static bool project_patch(const picture *from, const picture *to, const double m[12], double u, double v,
                          double inverse, patch *out) {
  const pags_camera *f = &from->camera, *t = &to->camera;
  double x = (u - f->cx) / f->fx, y = (v - f->cy) / f->fy, q[3];
  for (int i = 0; i < 3; i++)
    q[i] = m[4 * i] * x + m[4 * i + 1] * y + m[4 * i + 2] + m[4 * i + 3] * inverse; /* divided by the depth */
  if (!(q[2] > 0.05))
    return false;
  double px = q[0] / q[2], py = q[1] / q[2];
  double su = t->fx / (q[2] * f->fx), sv = t->fy / (q[2] * f->fx), ru = t->fx / (q[2] * f->fy),
         rv = t->fy / (q[2] * f->fy);
  *out = (patch){.u = t->fx * px + t->cx,
                 .v = t->fy * py + t->cy,
                 .a = su * (m[0] - px * m[8]),
                 .b = ru * (m[1] - px * m[9]),
                 .c = sv * (m[4] - py * m[8]),
                 .d = rv * (m[5] - py * m[9])};
  double area = fabs(out->a * out->d - out->b * out->c);
  return area > 0.25 && area < 4 && inside(to, out);
}

/* Returns the mean correlation of a ray's patch at depth 1 / inverse with the better half (at least two) of the
 * neighbours that see it; the worse half may be occluded. Returns -1 if fewer than two neighbours see the patch. */
static double score_at(const matcher *m, const ray *r, const float own[TAPS], const double (*motions)[12],
                       double inverse) {
  const picture *p = &m->pictures[r->picture];
  double scores[NEIGHBOURS];
  int seen = 0;
  for (int k = 0; k < NEIGHBOURS && p->neighbours[k] >= 0; k++) {
    const picture *other = &m->pictures[p->neighbours[k]];
    patch q;
    float taps[TAPS], dot = 0;
    if (!project_patch(p, other, motions[k], r->u, r->v, inverse, &q) || !normalised_taps(other, &q, taps))
      continue;
    for (int n = 0; n < TAPS; n++)
      dot += own[n] * taps[n];
    int at = seen++;
    for (; at > 0 && scores[at - 1] < (double)dot; at--)
      scores[at] = scores[at - 1];
    scores[at] = (double)dot;
  }
  if (seen < 2)
    return -1;
  int half = (seen + 1) / 2 > 2 ? (seen + 1) / 2 : 2;
  double sum = 0;
  for (int k = 0; k < half; k++)
    sum += scores[k];
  return sum / half;
}

/* Returns 1 / depth of the test depth with index `step`, 0..DEPTHS - 1, from the farthest to the nearest. */
static double inverse_of(const matcher *m, double step) {
  double low = 1 / (farthest * m->distance), high = 1 / (nearest * m->distance);
  return low + (high - low) * step / (DEPTHS - 1);
}

/* Finds the depth of a ray with the highest score. A parabola through the best score and the scores before and after
 * it gives the position between the tested depths. */
static void match_ray(const matcher *m, ray *r) {
  const picture *p = &m->pictures[r->picture];
  const patch straight = {.u = r->u, .v = r->v, .a = 1, .d = 1};
  float own[TAPS];
  double motions[NEIGHBOURS][12], scores[DEPTHS];
  if (!inside(p, &straight) || !normalised_taps(p, &straight, own))
    return;
  for (int k = 0; k < NEIGHBOURS && p->neighbours[k] >= 0; k++) {
    /* The rigid motion from the camera of this picture to the camera of neighbour k. */
    double inverse[12];
    pags_rigid_inverse(m->pictures[p->neighbours[k]].camera.world_from_camera, inverse);
    pags_rigid_multiply(inverse, p->camera.world_from_camera, motions[k]);
  }
  int best = 0;
  for (int i = 0; i < DEPTHS; i++) {
    scores[i] = score_at(m, r, own, (const double(*)[12])motions, inverse_of(m, i));
    if (scores[i] > scores[best])
      best = i;
  }
  if (scores[best] < sure_score || best == 0 || best == DEPTHS - 1)
    return;
  double before = scores[best - 1], after = scores[best + 1], bend = before - 2 * scores[best] + after;
  double shift = bend < -1e-9 && before > -1 && after > -1 ? 0.5 * (before - after) / bend : 0;
  r->inverse = inverse_of(m, best + fmax(-0.5, fmin(0.5, shift)));
  r->sure = true;
}

static size_t pixel_of(const picture *p, double u, double v) {
  int x = (int)u, y = (int)v;
  x = x < p->width ? x : p->width - 1;
  y = y < p->height ? y : p->height - 1;
  return (size_t)y * (size_t)p->width + (size_t)x;
}

static void match_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  matcher *m = context;
  for (int64_t i = begin; i < end; i++) {
    ray *r = &m->rays[i];
    r->picture = (int)(i % m->count);
    const picture *p = &m->pictures[r->picture];
    for (uint64_t k = 0; k < TRIES; k++) { /* draw again while the mask excludes the pixel */
      double pixel[2];
      pags_rng_uniform2(m->seed, STREAM + k, (uint64_t)i, pixel);
      r->u = pixel[0] * p->width;
      r->v = pixel[1] * p->height;
      if (!p->mask || p->mask[pixel_of(p, r->u, r->v)])
        break;
    }
    match_ray(m, r);
  }
}

/* ---- Points from the rays ---- */

/* Returns the ray nearest to `r`, in pixels, among the rays of the same picture with an accepted depth; NULL if the
 * picture has none. The rays of a picture are every m->count-th of all rays. */
static const ray *nearest_sure(const matcher *m, const ray *r) {
  const ray *best = NULL;
  double least = INFINITY;
  for (int64_t i = r->picture; i < m->ray_count; i += m->count) {
    const ray *other = &m->rays[i];
    double square = (other->u - r->u) * (other->u - r->u) + (other->v - r->v) * (other->v - r->v);
    if (other->sure && square < least) {
      least = square;
      best = other;
    }
  }
  return best;
}

static void emit_block(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  matcher *m = context;
  for (int64_t i = begin; i < end; i++) {
    const ray *r = &m->rays[i], *from = r->sure ? r : nearest_sure(m, r);
    const picture *p = &m->pictures[r->picture];
    const double draw = pags_rng_uniform(m->seed, STREAM + TRIES, (uint64_t)i);
    const double inverse = from ? from->inverse : 1 / pags_focus_depth(m->distance, draw);
    double point[3];
    point_on_ray(&p->camera, r->u, r->v, 1 / inverse, point);
    for (int c = 0; c < 3; c++)
      m->xyz[3 * i + c] = (float)(point[c] - m->dataset->origin[c]);
    memcpy(m->rgb + 3 * i, p->rgb + 3 * pixel_of(p, r->u, r->v), 3);
  }
}

/* ---- The whole run ---- */

static pags_result match_all(matcher *m, pags_tasks *tasks) {
  PAGS_TRY(pags_parallel_try(tasks, m->count, load_picture, m, "cancelled while reading photographs"));
  for (int i = 0; i < m->count; i++) {
    /* Choose the NEIGHBOURS pictures with the least partner cost. */
    picture *p = &m->pictures[i];
    double costs[NEIGHBOURS];
    for (int k = 0; k < NEIGHBOURS; k++) {
      p->neighbours[k] = -1;
      costs[k] = INFINITY;
    }
    for (int j = 0; j < m->count; j++) {
      double cost = j == i ? INFINITY : partner_cost(m, p, &m->pictures[j]);
      for (int k = NEIGHBOURS - 1; k >= 0 && cost < costs[k]; k--) { /* insertion sort, least cost first */
        if (k < NEIGHBOURS - 1) {
          costs[k + 1] = costs[k];
          p->neighbours[k + 1] = p->neighbours[k];
        }
        costs[k] = cost;
        p->neighbours[k] = j;
      }
    }
  }
  /* Blocks of 128 rays: the usual number of points gives some fifty or more of them. */
  if (!pags_parallel_for(tasks, m->ray_count, 128, match_block, m) ||
      !pags_parallel_for(tasks, m->ray_count, 128, emit_block, m))
    return pags_fail(PAGS_CANCELLED, "cancelled while looking for points");
  int64_t sure = 0;
  for (int64_t i = 0; i < m->ray_count; i++)
    sure += m->rays[i].sure;
  pags_log_message(PAGS_LOG_INFO, "%s: %lld points to start from, %lld of them matched between photographs",
                   m->dataset->path, (long long)m->ray_count, (long long)sure);
  return PAGS_OK;
}

static pags_result prepare(matcher *m) {
  m->views = malloc(MOST_PICTURES * sizeof *m->views);
  m->pictures = calloc(MOST_PICTURES, sizeof *m->pictures);
  m->rays = calloc((size_t)m->ray_count, sizeof *m->rays);
  m->xyz = malloc((size_t)m->ray_count * 3 * sizeof *m->xyz);
  m->rgb = malloc((size_t)m->ray_count * 3);
  PAGS_CHECK_MEMORY(m->views && m->pictures && m->rays && m->xyz && m->rgb, "%s", m->dataset->path);

  /* Take every training view, or an evenly spaced choice of MOST_PICTURES of them. */
  int64_t training = 0, seen = 0;
  for (int64_t i = 0; i < m->dataset->count; i++)
    training += !m->dataset->views[i].test && !pags_dataset_is_far(m->dataset, i);
  int64_t step = (training + MOST_PICTURES - 1) / MOST_PICTURES;
  for (int64_t i = 0; i < m->dataset->count; i++)
    if (!m->dataset->views[i].test && !pags_dataset_is_far(m->dataset, i) && seen++ % step == 0)
      m->views[m->count++] = i;

  const pags_camera *cameras[MOST_PICTURES];
  for (int i = 0; i < m->count; i++)
    cameras[i] = &m->dataset->views[m->views[i]].camera;
  return pags_focus_distance(cameras, m->count, &m->distance);
}

static void matcher_destroy(matcher *m) {
  for (int i = 0; i < m->count; i++) {
    free(m->pictures[i].rgb);
    free(m->pictures[i].grey);
    free(m->pictures[i].mask);
  }
  free(m->views);
  free(m->pictures);
  free(m->rays);
  free(m->xyz);
  free(m->rgb);
}

pags_result pags_dataset_match_points(const pags_dataset *dataset, pags_tasks *tasks, int64_t count, uint64_t seed,
                                      float **xyz, uint8_t **rgb) {
  assert(dataset && tasks && xyz && rgb && count > 0 && count < INT32_MAX);
  PAGS_AUTO(matcher_destroy) matcher m = {.dataset = dataset, .seed = seed, .ray_count = count};
  *xyz = NULL;
  *rgb = NULL;
  PAGS_TRY(prepare(&m));
  PAGS_TRY(match_all(&m, tasks));
  *xyz = pags_take(&m.xyz);
  *rgb = pags_take(&m.rgb);
  return PAGS_OK;
}
