/* SPDX-License-Identifier: Apache-2.0 */
/* A counter on one stream of the engine's random numbers (base/rng.h). The builders of the synthetic scenes draw from
 * it one number after another. */
#ifndef PAGS_SYNTH_DICE_H
#define PAGS_SYNTH_DICE_H

#include "base/rng.h"

typedef struct pags_dice {
  uint64_t seed, stream, count;
} pags_dice;

/* Uniform in [lo, hi). */
static inline float pags_dice_between(pags_dice *dice, float lo, float hi) {
  return lo + (hi - lo) * (float)pags_rng_uniform(dice->seed, dice->stream, dice->count++);
}

/* A uniformly drawn integer in 0 .. count - 1. */
static inline int pags_dice_pick(pags_dice *dice, int count) {
  return (int)pags_rng_below(dice->seed, dice->stream, dice->count++, (uint64_t)count);
}

#endif
