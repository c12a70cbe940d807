/* SPDX-License-Identifier: Apache-2.0 */
/* Estimates a run's memory from counts and its time from a few timed passes.
 *
 * Assumptions: the number of Gaussians ends at its limit, or at 8 times the start if that is less (the usual factor
 * of 3DGS from structure-from-motion points), or with pruning by score at the geometric mean of the start and of two
 * fifths of a photograph's pixels if that is less (within a factor of 2 on fox, pandaset-002 and street), and changes
 * linearly until densify_until. The cost of a pass has a part
 * proportional to the number of Gaussians (cull, project, shade, sort, Adam) and a part that depends on the pixels,
 * which doubles as a scene fills up (measured between an early and a finished state). */
#include "train/score_pass.h"
#include "train/stages.h"
#include "train/views.h"

enum { PROBES = 4 };
static const double growth = 8.0, pixel_share = 0.4, peak_share = 1.5;
static const double pixel_growth = 2.0;

/* Returns the bytes that training needs. Per Gaussian: parameters and two moments (planes x 4 bytes each), each with
 * half as much room again for growth; statistics 8; scratch of reordering 12; the frame's splat 64; key, tiles and
 * places 32; at 12 tiles per Gaussian 12 entries of 8, masks of 2 and partial gradients of 48. Per pixel: the frame's
 * planes 40, gradients 12, loss 80, photograph 3. Plus 64 MiB. */
uint64_t pags_train_bytes(int64_t gaussians, int sh_degree, int width, int height) {
  uint64_t planes = (uint64_t)pags_plane_count(sh_degree);
  uint64_t each = planes * 4 * 3 * 3 / 2 + 8 + 12 + 64 + 32 + 12 * (8 + 2 + 48);
  uint64_t pixel = 40 + 12 + 80 + 3;
  return (uint64_t)gaussians * each + (uint64_t)width * (uint64_t)height * pixel + ((uint64_t)64 << 20);
}

uint64_t pags_batch_bytes(const pags_train_config *config, int64_t gaussians, int sky_size) {
  const int degree = config->color.sh_degree, changing = config->objects.fourier == PAGS_FOURIER_ALL ? degree : 0;
  const uint64_t planes = (uint64_t)(pags_plane_count(degree) + PAGS_FOURIER_PLANES * pags_sh_coefficients(changing));
  const uint64_t texels = 6 * (uint64_t)sky_size * (uint64_t)sky_size;
  return config->schedule.batch > 1 ? (uint64_t)gaussians * planes * 4 * 3 / 2 + 3 * 4 * texels : 0;
}

/* Milliseconds of a photograph at one resolution level: `rows` is the part proportional to the number of Gaussians,
 * `pixels` the part that depends on the pixels. With several ranks, a photograph's share of its step's rounds. */
typedef struct cost {
  double rows, pixels;
} cost;

/* Milliseconds that a frame's last view has spent on what is proportional to the number of Gaussians. */
static double rows_ms(const pags_frame *frame) {
  const pags_frame_stats *s = pags_frame_stats_get(frame);
  return s->ms_cull + s->ms_project + s->ms_shade + s->ms_sort + s->ms_project_backward;
}

static pags_result probe(pags_trainer *t, int level, cost *out) {
  const int64_t batch = t->state.schedule.batch, rounds = (batch + t->ranks - 1) / t->ranks;
  const int count = batch < t->ranks ? (int)batch : t->ranks;
  const double share = (double)rounds / (double)batch;
  for (int64_t i = 0; i <= PROBES; i++) { /* the first pass warms up and isn't measured */
    for (int k = 0; k < count; k++)
      t->round[k] = (pags_step_view){.number = t->state.step * batch + 1,
                                     .view = t->views[(i * count + k) * t->view_count / ((PROBES + 1) * count)],
                                     .level = level};
    const double begin = pags_clock_ms(), waited = t->ms.wait.wall;
    t->measuring = true;
    const pags_result result = pags_train_round(t, t->state.step + 1, t->round, count);
    t->measuring = false;
    PAGS_TRY(result);
    const double whole = pags_clock_ms() - begin - (t->ms.wait.wall - waited);
    double rows = rows_ms(t->render.frame);
    for (int k = 0; t->ranks > 1 && k < count; k++)
      rows += rows_ms(t->shared.owners[k]);
    if (i == 0)
      continue;
    out->rows += share * rows / PROBES;
    out->pixels += share * fmax(whole - rows, 0.0) / PROBES;
  }
  return PAGS_OK;
}

pags_result pags_trainer_estimate(pags_trainer *t, pags_estimate *out) {
  pags_train_state *s = &t->state;
  const pags_schedule *d = &s->schedule;
  const double now = fmax((double)pags_state_gaussian_count(s), 1.0);

  /* The number of Gaussians at the end, and their mean number over the run relative to that now. */
  double final = growth * now;
  if (d->prunes > 0)
    final = fmin(final, sqrt(now * pixel_share * pags_views_mean_pixels(t)));
  if (s->cap > 0)
    final = fmin((double)s->cap, final);
  const double share = fmin((double)d->densify_until / (double)s->stop, 1.0);
  const double mean = (share * 0.5 * (now + final) + (1.0 - share) * final) / now;
  const double rows = d->prunes > 0 ? mean : fmax(mean, 1.0);

  const int64_t quarter = d->quarter_until, half = d->half_until > quarter ? d->half_until : quarter;
  const int64_t steps[3] = {s->stop - half, half - quarter, quarter};
  double ms = 0.0, full = 0.0;
  for (int k = 0; k < 3; k++) {
    cost c = {0.0, 0.0};
    if (steps[k] <= 0)
      continue;
    PAGS_TRY(probe(t, 1 << k, &c));
    const double each = c.rows * rows + c.pixels * pixel_growth;
    ms += (double)steps[k] * (double)d->batch * each;
    full = full > 0.0 ? full : each; /* the time of a view at the finest level of the run */
  }
  out->step_seconds = ms / (double)s->stop / 1e3;

  /* A scored view costs as much as a step: drawing it is a step's forward half, and summing each Gaussian's
   * contribution goes through the (Gaussian, pixel) pairs like the backward half. Prunes score at half size, where
   * there are fewer pairs but as many Gaussians: those views count half. At the end one rank scores alone. */
  const bool at_end = (pags_score_pass_has_labels(t->dataset) && d->config.priority.score == PAGS_SCORE_DEFAULT) ||
                      (d->config.size_limit.sh_loss > 0.0 && d->config.color.sh_degree > 0);
  const double at_prunes = d->config.priority.score == PAGS_SCORE_DEFAULT ? 0.5 * d->prunes : 0.0;
  out->scoring_seconds = (at_prunes + (at_end ? t->ranks : 0)) * (double)t->view_count * full / 1e3;

  /* Memory: that of training at the size of the largest view, of the image cache and of the sky. */
  const int64_t gaussians = (int64_t)fmax(final, d->prunes > 0 ? peak_share * now : 0);
  int width, height;
  pags_views_largest(t, &width, &height);
  out->bytes = pags_train_bytes(gaussians, d->config.color.sh_degree, width, height) + t->options->image_cache +
               pags_sky_fit_bytes(s->sky.sky.size) + pags_batch_bytes(&d->config, gaussians, s->sky.sky.size);
  return PAGS_OK;
}
