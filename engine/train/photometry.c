/* SPDX-License-Identifier: Apache-2.0 */
/* Fits vignettes and response curves of a rig's cameras by Adam; see photometry.h.
 * With x the picture's value and u = x times the vignette's factor, which is linear in its numbers, the camera shows
 * y = f(u). The curve f rises by w_i = exp(s_i) / sum exp(s) in piece i. A point at the share t of piece i
 * is at f = w_0 + ... + w_(i-1) + t w_i, and df/ds_j = w_j (c_j - f) with c_j = 1 for j < i, t for j = i, else 0. */
#include "train/photometry.h"

#include <math.h>

#include "base/memory.h"
#include "base/parallel.h"
#include "maths/maths.h"
#include "simd/kernels.h"

enum { RINGS = PAGS_VIGNETTING_RINGS, PIECES = PAGS_RESPONSE_PIECES, GRAIN = 8 };
static const double final_share = 0.1; /* the learning rate at the schedule's end as a share of the first */

/* Sets the share of the picture that each number of the vignette has. */
static void find_shares(const pags_camera *camera, double share[RINGS]) {
  enum { GRID = 64 };
  memset(share, 0, RINGS * sizeof *share);
  for (int y = 0; y < GRID; y++)
    for (int x = 0; x < GRID; x++) {
      const double q =
          pags_photometric_radius2(camera, (x + 0.5) / GRID * camera->width, (y + 0.5) / GRID * camera->height);
      const int ring = q < 2.0 / 3.0 ? (int)(3.0 * q) : 2;
      share[ring] += (1.0 + ring - 3.0 * q) / (GRID * GRID);
      share[ring + 1] += (3.0 * q - ring) / (GRID * GRID);
    }
}

pags_result pags_photometry_create(pags_photometry *p, const pags_dataset *dataset) {
  *p = (pags_photometry){.holdout = pags_holdout_test_begin()};
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const int64_t number = pags_dataset_view(dataset, i)->sensor;
    p->count = number >= p->count ? number + 1 : p->count;
  }
  p->parts = calloc((size_t)p->count + 1, sizeof *p->parts);
  PAGS_CHECK_MEMORY(p->parts, "the light of %lld cameras", (long long)p->count);
  for (int64_t i = 0; i < pags_dataset_view_count(dataset); i++) {
    const pags_view *view = pags_dataset_view(dataset, i);
    if (view->sensor >= 0)
      find_shares(&view->camera, p->parts[view->sensor].share);
  }
  return PAGS_OK;
}

void pags_photometry_destroy(pags_photometry *p) {
  free(p->parts);
  *p = (pags_photometry){.holdout = p->holdout};
}

pags_photometric pags_photometry_of_sensor(const pags_photometry *p, int sensor) {
  pags_photometric light = {.vignette = {0.0}};
  double shares[PIECES], sum = 0.0, at = 0.0;
  if (sensor < 0 || sensor >= p->count)
    return light;
  memcpy(light.vignette, p->parts[sensor].vignette, sizeof light.vignette);
  for (int i = 0; i < PIECES; i++)
    sum += shares[i] = pags_exp(p->parts[sensor].slopes[i]);
  for (int i = 0; i < PIECES - 1; i++) {
    at += shares[i] / sum; /* w of the curve's pieces */
    light.response[i] = at - (i + 1) / (double)PIECES;
  }
  return light;
}

/* ---- Pictures ---- */

typedef struct light_job {
  const pags_kernels *kernels;
  const pags_camera *camera;
  const pags_picture *picture;
  float *const *planes;
  pags_light_row row;              /* the members that are the same for all rows */
  pags_photometric_gradient *rows; /* one a row; NULL: the planes receive the light's values */
} light_job;

static pags_result prepare(const pags_photometric *light, const pags_camera *camera, const pags_picture *picture,
                           float *const planes[3], light_job *job) {
  const char *why;
  *job = (light_job){.kernels = pags_kernels_get(&why), .camera = camera, .picture = picture, .planes = planes};
  if (!job->kernels)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s", why);
  pags_light_row *const row = &job->row;
  row->width = picture->width;
  row->cx = (float)camera->cx;
  row->per_corner = (float)(1.0 / (camera->cx * camera->cx + camera->cy * camera->cy));
  double slope = 0.0;
  row->vignette[0] = (float)(1.0 + light->vignette[0]);
  for (int k = 1; k < RINGS; k++) {
    const double next = 3.0 * (light->vignette[k] - light->vignette[k - 1]);
    row->vignette[k] = (float)(next - slope);
    slope = next;
  }
  slope = 1.0;
  for (int i = 0; i < PIECES; i++) {
    const double next = PIECES * (pags_photometric_curve_point(light, i + 1) - pags_photometric_curve_point(light, i));
    row->bends[i] = (float)(next - slope);
    slope = next;
  }
  return PAGS_OK;
}

static void light_rows(void *context, int64_t begin, int64_t end, PAGS_UNUSED int worker) {
  const light_job *const job = context;
  for (int64_t y = begin; y < end; y++) {
    pags_light_row row = job->row;
    const double down = (double)y + 0.5 - job->camera->cy;
    row.y_squared = (float)(down * down);
    for (int c = 0; c < 3; c++) {
      row.rgb[c] = job->picture->rgb[c] + y * job->picture->stride;
      row.planes[c] = job->planes[c] + y * job->picture->stride;
    }
    if (job->rows)
      job->kernels->light_back(&row, job->rows[y].vignette, job->rows[y].slopes);
    else
      job->kernels->light_row(&row);
  }
}

pags_result pags_photometry_apply(pags_tasks *tasks, const pags_photometric *light, const pags_camera *camera,
                                  const pags_picture *picture, float *const out[3]) {
  light_job job;
  PAGS_TRY(prepare(light, camera, picture, out, &job));
  return pags_parallel_run(tasks, picture->height, GRAIN, light_rows, &job);
}

pags_result pags_photometry_back(pags_tasks *tasks, const pags_photometric *light, const pags_camera *camera,
                                 const pags_picture *picture, float *const gradient[3],
                                 pags_photometric_gradient *out) {
  light_job job;
  memset(out, 0, sizeof *out);
  PAGS_TRY(prepare(light, camera, picture, gradient, &job));
  PAGS_AUTOFREE pags_photometric_gradient *rows = malloc((size_t)picture->height * sizeof *rows);
  PAGS_CHECK_MEMORY(rows, "the light of a picture of %d rows", picture->height);
  job.rows = rows;
  PAGS_TRY(pags_parallel_run(tasks, picture->height, GRAIN, light_rows, &job));
  for (int y = 0; y < picture->height; y++) {
    for (int k = 0; k < RINGS; k++)
      out->vignette[k] += rows[y].vignette[k];
    for (int i = 0; i < PIECES; i++)
      out->slopes[i] +=
          rows[y].slopes[i] * (pags_photometric_curve_point(light, i + 1) - pags_photometric_curve_point(light, i));
  }
  return PAGS_OK;
}

/* ---- Training ---- */

/* Sets to zero: the mean of each camera's vignette over the picture, which is a gain; the mean of the slopes of each
 * camera, which changes nothing; and that of each piece over the cameras, which the scene's colours make up for. */
static void hold_means(pags_photometry *p) {
  for (pags_photometry_part *part = p->parts; part < p->parts + p->count; part++) {
    double mean = 0.0, bright = 0.0;
    for (int k = 0; k < RINGS; k++)
      bright += part->share[k] * part->vignette[k];
    for (int k = 0; k < RINGS; k++)
      part->vignette[k] -= bright;
    for (int i = 0; i < PIECES; i++)
      mean += part->slopes[i] / PIECES;
    for (int i = 0; i < PIECES; i++)
      part->slopes[i] -= mean;
  }
  for (int i = 0; i < PIECES; i++) {
    double mean = 0.0, seen = 0.0;
    for (int64_t s = 0; s < p->count; s++) {
      seen += p->parts[s].by_slopes.count > 0;
      mean += p->parts[s].slopes[i];
    }
    for (int64_t s = 0; s < p->count; s++)
      p->parts[s].slopes[i] -= p->parts[s].by_slopes.count > 0 ? mean / seen : 0.0;
  }
}

bool pags_photometry_update(pags_photometry *p, int sensor, const pags_photometric_gradient *gradient,
                            const pags_schedule *schedule, int64_t step) {
  const pags_train_config *c = &schedule->config;
  pags_photometry_part *part = &p->parts[sensor];
  double by_vignette[6] = {0.0}, direction[2][6];
  memcpy(by_vignette, gradient->vignette, sizeof gradient->vignette);
  if (!pags_adam6_step(&part->by_vignette, by_vignette, c, direction[0]) ||
      !pags_adam6_step(&part->by_slopes, gradient->slopes, c, direction[1]))
    return false;
  const double rate = c->cameras.light_rate * pags_pow(final_share, fmin((double)step / (double)schedule->length, 1.0));
  for (int k = 0; k < RINGS; k++)
    part->vignette[k] -= rate * direction[0][k];
  for (int i = 0; i < PIECES; i++)
    part->slopes[i] -= 5.0 * rate * direction[1][i]; /* before gains and offsets take the place of a curve */
  hold_means(p);
  return true;
}
