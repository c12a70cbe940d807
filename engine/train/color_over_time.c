/* SPDX-License-Identifier: Apache-2.0 */
/* Decides which moving objects get a colour that changes over time, by their errors on the training views. The error
 * of an object's pixels is fitted over time with Fourier terms, by least squares weighted by the number of pixels.
 * The gain is what the fit explains beyond a constant term, which the static colour would learn by itself. */
#include "train/stages.h"

#include "base/log.h"
#include "cluster/shares.h"
#include "maths/maths.h"
#include "train/views.h"

enum { TERMS = 5, SHRINK = 2 };

/* Objects with fewer pixels or time steps than these get no Fourier terms: their errors say too little. */
static const double least_pixels = 500.0;
static const int least_steps = 8;

/* Normal equations of one object's fit: matrix and, per channel, right side. */
typedef struct object_fit {
  double a[TERMS][TERMS], b[3][TERMS];
  double squares; /* sum of squared errors over pixels and channels */
  double pixels;
  int steps, last_frame;
} object_fit;

/* Sums of the error of one object's pixels in one view. */
typedef struct object_error {
  double sum[3], squares, pixels;
} object_error;

/* How much smaller than a photograph of that level the pictures are. */
static int factor_of(int level) {
  return level < SHRINK ? SHRINK / level : 1;
}

/* The mean of a channel over the factor x factor pixels of the photograph under pixel (x, y) of a smaller picture,
 * 0..1; -1 if the mask excludes one of them. */
static double target_at(const pags_photo *photo, int c, int x, int y, int factor) {
  const int64_t stride = photo->stride, plane = c * photo->height * stride;
  double sum = 0.0;
  for (int64_t j = (int64_t)y * factor; j < ((int64_t)y + 1) * factor; j++)
    for (int64_t i = (int64_t)x * factor; i < ((int64_t)x + 1) * factor; i++) {
      if (photo->mask && !photo->mask[j * stride + i])
        return -1.0;
      sum += photo->rgb[plane + j * stride + i];
    }
  return sum / (255.0 * factor * factor);
}

/* Returns b' A^-1 b, the sum of squares that a fit with terms 0 .. n - 1 explains, by Cholesky factorisation. A
 * slight ridge is added to A because short tracks see only part of the basis. */
static double explained(const object_fit *f, const double b[TERMS], int n) {
  double l[TERMS][TERMS] = {{0.0}}, y[TERMS], sum = 0.0;
  for (int i = 0; i < n; i++) {
    for (int j = 0; j <= i; j++) {
      double s = f->a[i][j] + (i == j ? 1e-3 * f->pixels : 0.0);
      for (int k = 0; k < j; k++)
        s -= l[i][k] * l[j][k];
      l[i][j] = i == j ? sqrt(fmax(s, 1e-12)) : s / l[j][j];
    }
    y[i] = b[i];
    for (int k = 0; k < i; k++)
      y[i] -= l[i][k] * y[k];
    y[i] /= l[i][i];
    sum += y[i] * y[i];
  }
  return sum;
}

/* Draws this rank's view of the round, the training view `index`, and sums up the errors of each object over the pixels
 * where its Gaussian has the largest weight. */
static pags_result find_errors(pags_trainer *t, int64_t index, const pags_frame_options *options,
                               object_error *errors) {
  int level;
  pags_photo photo;
  pags_picture picture;
  PAGS_TRY(pags_views_photo(t, index, &level, &photo));
  const int factor = factor_of(level);
  PAGS_TRY(pags_round_draw(t, t->state.step + 1, options, &picture));
  memset(errors, 0, (size_t)t->state.model_count * sizeof *errors);
  const pags_train_model *const models = t->state.models;
  for (int y = 0; y < picture.height; y++)
    for (int x = 0; x < picture.width; x++) {
      const int64_t at = (int64_t)y * picture.stride + x, id = picture.id[at];
      if (id < models[0].total || target_at(&photo, 0, x, y, factor) < 0.0)
        continue;
      int64_t model = 0, rows = models[0].total;
      while (id >= rows)
        rows += models[++model].total;
      object_error *e = &errors[model];
      for (int c = 0; c < 3; c++) {
        const double error = target_at(&photo, c, x, y, factor) - (double)picture.rgb[c][at];
        e->sum[c] += error;
        e->squares += error * error;
      }
      e->pixels += 1.0;
    }
  return PAGS_OK;
}

/* Adds each object's errors in a view to the normal equations of its fit. */
static void add_errors(pags_trainer *t, int64_t view, const object_error *errors, object_fit *fits) {
  const int frame = pags_dataset_view(t->dataset, view)->frame;
  pags_view_render_compose(t, view);
  for (int i = 0; i < t->render.part_count; i++) {
    int64_t model = t->render.drawn[i].model;
    const object_error *e = &errors[model];
    object_fit *f = &fits[model];
    const double *basis = t->render.models[model].basis;
    if (e->pixels <= 0.0)
      continue;
    f->steps += f->last_frame != frame;
    f->last_frame = frame;
    f->pixels += e->pixels;
    f->squares += e->squares;
    for (int k = 0; k < TERMS; k++) {
      for (int l = 0; l < TERMS; l++)
        f->a[k][l] += e->pixels * basis[k] * basis[l];
      for (int c = 0; c < 3; c++)
        f->b[c][k] += e->sum[c] * basis[k];
    }
  }
}

/* Looks at `count` training views, one a rank. `errors`: those of this rank's view, then those of all. */
static pags_result add_round(pags_trainer *t, const int64_t *indices, int count, object_error *errors,
                             object_fit *fits) {
  const int64_t models = t->state.model_count;
  pags_transport *const transport = t->shared.transport;
  pags_frame_options options = pags_view_render_options(t, t->state.step);
  options.extra_channels = 1;
  for (int i = 0; i < count; i++) {
    const int level = pags_views_level(t, indices[i]);
    const int64_t view = t->views[indices[i]];
    t->round[i] = (pags_step_view){.view = view, .camera = pags_view_render_camera(t, view, level * factor_of(level))};
  }
  PAGS_TRY(pags_round_project(t, t->state.step + 1, count, &options));
  const bool draws = t->shared.rank < count;
  PAGS_TRY(
      pags_transport_agree(transport, draws ? find_errors(t, indices[t->shared.rank], &options, errors) : PAGS_OK));
  PAGS_TRY(pags_share_all(transport, errors, models * (int64_t)sizeof *errors, errors + models));
  for (int i = 0; i < count; i++)
    add_errors(t, t->round[i].view, errors + (1 + i) * models, fits);
  return PAGS_OK;
}

/* Fits all objects' errors. Views without one are left out. */
static pags_result fit_views(pags_trainer *t, object_error *errors, object_fit *fits) {
  int64_t indices[PAGS_RANKS_MOST];
  int count = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    pags_view_render_compose(t, t->views[i]);
    if (t->render.part_count > 1)
      indices[count++] = i;
    if (count == 0 || (count < t->ranks && i + 1 < t->view_count))
      continue;
    PAGS_TRY(add_round(t, indices, count, errors, fits));
    count = 0;
  }
  return PAGS_OK;
}

pags_result pags_color_over_time_decide(pags_trainer *t) {
  const size_t models = (size_t)t->state.model_count;
  PAGS_AUTOFREE object_error *errors = calloc(models * (1 + (size_t)t->ranks), sizeof *errors);
  PAGS_AUTOFREE object_fit *fits = calloc(models, sizeof *fits);
  PAGS_CHECK_MEMORY(errors && fits, "%zu fits", models);
  for (size_t i = 0; i < models; i++)
    fits[i].last_frame = -1;
  PAGS_TRY(fit_views(t, errors, fits));
  int64_t given = 0;
  for (size_t i = 1; i < models; i++) {
    pags_train_model *m = &t->state.models[i];
    const object_fit *f = &fits[i];
    double less = 0.0; /* the PSNR gain in dB that the fit with time-varying terms promises over a constant one */
    for (int c = 0; c < 3; c++)
      less += explained(f, f->b[c], TERMS) - explained(f, f->b[c], 1);
    const bool shown = f->pixels >= least_pixels && f->steps >= least_steps && f->squares > 0.0;
    m->fourier_gain = shown ? -10.0 * pags_log10(fmax(1.0 - less / f->squares, 1e-6)) : 0.0;
    if (m->fourier_gain < m->schedule.config.objects.fourier_gain)
      continue;
    PAGS_TRY(pags_model_add_fourier(m, 0));
    given++;
  }
  pags_log_message(PAGS_LOG_INFO, "colour over time for %lld of %lld objects", (long long)given, (long long)models - 1);
  return PAGS_OK;
}
