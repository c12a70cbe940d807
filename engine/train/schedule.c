/* SPDX-License-Identifier: Apache-2.0 */
/* The schedule of Kerbl et al. (2023), stretched to any number of iterations.
 *
 * Steps that the configuration gives "of 30 000" become round(step * length / 30 000). Two intervals have a lower
 * limit: densify waits for at least one pass over the training views, without which its statistics, means over the
 * views in which a Gaussian was seen, are incomplete, and for densify_apart photographs or a 40th of the run, whichever
 * is less; a reset waits for at least three passes, about what opacities take to recover from the last one. */
#include "train/schedule.h"

#include <math.h>

#include "base/rng.h"
#include "maths/maths.h"
#include "train/config.h"

static const double reference_iterations = 30000.0;

/* Photographs that Gaussians need to fill the picture again after their scales were reset, however short the run. */
static const int64_t least_recovery = 200;

/* Steps of 30 000. */
static const int64_t first_scale_reset = 6000, scale_reset_interval = 3000, last_scale_reset = 21000;

static int64_t scaled(int64_t step, int64_t length) {
  return (long long)pags_round((double)step * (double)length / reference_iterations);
}

static int64_t at_least(int64_t value, int64_t least) {
  return value < least ? least : value;
}

/* Sets the steps of the prunes by score and their rates. Early ones, during densification, are moved to the next
 * densify step, so that no densify follows them closely; the paper's come exactly when it says. */
static void set_prunes(pags_schedule *s) {
  const pags_train_priority *p = &s->config.priority;
  for (int i = 0; i < p->prunes; i++) {
    int64_t step = scaled(p->prune_from + p->prune_every * i, s->length);
    int64_t after = (step + s->densify_every - 1) / s->densify_every * s->densify_every;
    const bool early = step < s->densify_until;
    if (early && after < s->densify_until && s->config.schedule.preset != PAGS_PRESET_PAPER)
      step = after;
    if (step <= 0 || step >= s->length || (s->prunes > 0 && step <= s->prune_step[s->prunes - 1]))
      continue; /* in a short run, a prune that coincides with another or with the end is left out */
    s->prune_rate[s->prunes] = early ? p->prune_early : p->prune_late;
    s->prune_step[s->prunes++] = step;
  }
}

int64_t pags_schedule_steps(const pags_schedule *s, int64_t photographs) {
  return (photographs + s->batch - 1) / s->batch;
}

pags_schedule pags_schedule_make(const pags_train_config *config, double extent, int64_t views) {
  pags_schedule s = {.config = pags_config_resolve(config, false), .extent = extent, .views = views};
  s.batch = at_least(config->schedule.batch, 1);
  const double beta1 = s.config.optimiser.beta1, beta2 = s.config.optimiser.beta2, power = (double)s.batch;
  s.rate_factor = sqrt(power);
  s.beta1 = s.batch == 1 || beta1 <= 0 ? beta1 : pags_pow(beta1, power);
  s.beta2 = s.batch == 1 ? beta2 : pags_pow(beta2, power);
  s.length = pags_schedule_steps(&s, config->schedule.schedule_iterations > 0 ? config->schedule.schedule_iterations
                                                                              : config->schedule.iterations);
  s.densify_from = scaled(config->density.densify_from, s.length);
  s.densify_until = scaled(s.config.density.densify_until, s.length);
  const int64_t apart = pags_schedule_steps(&s, s.config.density.densify_apart), share = s.length / 40;
  const int64_t least = at_least(pags_schedule_steps(&s, at_least(views, 1)), apart < share ? apart : share);
  s.densify_every = at_least(scaled(config->density.densify_every, s.length), least);
  int64_t reset =
      at_least(scaled(config->density.reset_every, s.length), pags_schedule_steps(&s, at_least(3 * views, 1)));
  s.reset_every = (reset + s.densify_every - 1) / s.densify_every * s.densify_every;
  s.scale_reset_from = scaled(first_scale_reset, s.length);
  s.scale_reset_every = at_least(scaled(scale_reset_interval, s.length), pags_schedule_steps(&s, least_recovery));
  s.scale_reset_until = scaled(last_scale_reset, s.length);
  s.sh_interval = at_least(scaled(config->color.sh_interval, s.length), 1);
  s.quarter_until = (long long)pags_round(config->schedule.quarter_until * (double)s.length);
  const double half = s.config.schedule.half_until;
  s.half_until = (long long)pags_round((half < 0 ? PAGS_LEAST_HALF_UNTIL : half) * (double)s.length);
  s.tracks_from = scaled(config->objects.tracks_from, s.length);
  s.fourier_from = scaled(config->objects.fourier_from, s.length);
  s.object_term_from = scaled(15000, s.length);

  set_prunes(&s);
  return s;
}

double pags_schedule_fall(const pags_schedule *s, int64_t step) {
  const double from = s->config.optimiser.rate_fall_from, t = (double)step / (double)s->length;
  if (t <= from)
    return s->rate_factor;
  return s->rate_factor * pags_exp((t < 1 ? (t - from) / (1 - from) : 1) * pags_log(s->config.optimiser.rate_fall));
}

void pags_schedule_falling_rates(const pags_train_config *c, double fall, double rates[PAGS_RATE_GROUPS]) {
  rates[PAGS_RATE_SCALE] = fall * c->optimiser.scale_rate;
  rates[PAGS_RATE_ROTATION] = fall * c->optimiser.rotation_rate;
  rates[PAGS_RATE_OPACITY] = fall * c->optimiser.opacity_rate;
  rates[PAGS_RATE_SH_DC] = fall * c->optimiser.sh_dc_rate;
  rates[PAGS_RATE_SH_REST] = fall * c->optimiser.sh_rest_rate;
  rates[PAGS_RATE_FOURIER] = fall * c->optimiser.sh_dc_rate;
}

void pags_schedule_rates(const pags_schedule *s, int64_t step, double rates[PAGS_RATE_GROUPS]) {
  const pags_train_config *c = &s->config;
  double t = (double)step / (double)s->length;
  t = t > 1.0 ? 1.0 : t;
  double position = c->optimiser.position_rate_begin <= 0.0
                        ? 0.0
                        : pags_exp((1.0 - t) * pags_log(c->optimiser.position_rate_begin) +
                                   t * pags_log(c->optimiser.position_rate_end));
  rates[PAGS_RATE_POSITION] = s->rate_factor * position * s->extent;
  pags_schedule_falling_rates(c, pags_schedule_fall(s, step), rates);
}

int pags_schedule_sh_degree(const pags_schedule *s, int64_t step) {
  int64_t degree = s->config.color.sh_interval == 0 ? s->config.color.sh_degree : step / s->sh_interval;
  return degree < s->config.color.sh_degree ? (int)degree : s->config.color.sh_degree;
}

bool pags_schedule_is_densify(const pags_schedule *s, int64_t step) {
  return step > s->densify_from && step < s->densify_until && step % s->densify_every == 0;
}

bool pags_schedule_is_draw(const pags_schedule *s, int64_t step) {
  return step > s->densify_from && step < s->length && step % s->densify_every == 0;
}

bool pags_schedule_is_lay(const pags_schedule *s, int64_t step) {
  return step > s->densify_from && step < s->length && step % at_least(s->densify_every / 20, 1) == 0;
}

int pags_schedule_prune(const pags_schedule *s, int64_t step) {
  for (int i = 0; i < s->prunes; i++)
    if (s->prune_step[i] == step)
      return i;
  return -1;
}

bool pags_schedule_is_reset(const pags_schedule *s, int64_t step) {
  int64_t recovery = s->reset_every / 3;
  if (s->config.density.strategy != PAGS_STRATEGY_DEFAULT || step >= s->densify_until)
    return false;
  for (int i = 0; i < s->prunes; i++) {
    int64_t prune = s->prune_step[i];
    if (step < prune && step > prune - recovery)
      return false;
    if (step == prune && prune / s->reset_every * s->reset_every > prune - recovery)
      return true;
  }
  return step % s->reset_every == 0;
}

bool pags_schedule_is_scale_reset(const pags_schedule *s, int64_t step) {
  return s->config.density.scale_reset < 1.0 && step >= s->scale_reset_from && step <= s->scale_reset_until &&
         step + s->scale_reset_every <= s->length && (step - s->scale_reset_from) % s->scale_reset_every == 0;
}

bool pags_schedule_prunes_large(const pags_schedule *s, int64_t step) {
  return step > s->reset_every;
}

int pags_schedule_level(const pags_schedule *s, int64_t step, int width, int height) {
  int level = step <= s->quarter_until ? 4 : step <= s->half_until ? 2 : 1;
  int shorter = width < height ? width : height;
  while (level > 1 && shorter / level < s->config.schedule.resolution_floor)
    level /= 2;
  return level;
}

bool pags_schedule_is_half_decision(const pags_schedule *s, int64_t step) {
  return s->config.schedule.half_until < 0 && step == s->half_until;
}

double pags_schedule_half_until(double ratio) {
  static const double most = 0.6, enough = 4;
  const double share = pags_log(fmin(fmax(ratio, 1), enough)) / pags_log(enough);
  return PAGS_LEAST_HALF_UNTIL + (most - PAGS_LEAST_HALF_UNTIL) * share;
}

void pags_schedule_set_half_until(pags_schedule *s, double fraction) {
  s->config.schedule.half_until = fraction;
  s->half_until = (long long)pags_round(fraction * (double)s->length);
}

void pags_schedule_order(const pags_schedule *s, int64_t epoch, int64_t *order) {
  pags_rng_permutation(s->config.schedule.seed, pags_draw(epoch, PAGS_DRAW_ORDER), order, s->views);
}
