/* SPDX-License-Identifier: Apache-2.0 */
/* The random draws of adaptive stochastic dropout, a pure function of seed, photograph, model and row; see dropout.h.
 */
#include "train/dropout.h"

#include <assert.h>
#include <math.h>

#include "base/rng.h"

enum { WORDS = 4 }; /* 32-bit words of one draw: that many rows share it */

pags_dropout pags_dropout_at(const pags_schedule *s, int64_t photograph, int64_t object) {
  const pags_train_config *c = &s->config;
  double share = fmin((double)photograph / (double)(s->length * s->batch), 1.0);
  return (pags_dropout){.seed = c->schedule.seed,
                        .photograph = photograph,
                        .object = object,
                        .most = c->priority.dropout ? c->priority.dropout_gamma * share : 0.0,
                        .beta = c->priority.dropout_beta};
}

static double rate_of(const pags_dropout *d, double s_sem) {
  return (1.0 - d->beta * s_sem) * d->most;
}

static float boost_of(double rate) {
  return (float)(1.0 / (1.0 - rate));
}

float pags_dropout_boost(const pags_dropout *d) {
  return boost_of(rate_of(d, 0.0));
}

void pags_dropout_draw(const pags_dropout *d, const float *s_sem, int64_t first, int64_t count, float *factor) {
  uint64_t model = (uint64_t)(d->object + 1) << 32;
  double rate = rate_of(d, 0.0);
  float boost = boost_of(rate);
  assert(first % WORDS == 0 && count % WORDS == 0);
  for (int64_t row = first; row < first + count; row += WORDS) {
    uint32_t words[WORDS];
    pags_rng_u32x4(d->seed, pags_draw(d->photograph, PAGS_DRAW_DROP), model | (uint64_t)((d->first_row + row) / WORDS),
                   words);
    for (int i = 0; i < WORDS; i++) {
      if (s_sem) {
        rate = rate_of(d, (double)s_sem[row + i]);
        boost = boost_of(rate);
      }
      factor[row + i] = (double)words[i] * 0x1p-32 < rate ? 0.0f : boost;
    }
  }
}
