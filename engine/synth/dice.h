/* SPDX-License-Identifier: Apache-2.0 */
/* A stream of random numbers for building things, one after the other. */
#ifndef PAGS_SYNTH_DICE_H
#define PAGS_SYNTH_DICE_H

#include "base/rng.h"

typedef struct pags_dice {
  uint64_t seed, stream, count;
} pags_dice;

static inline float pags_dice_between(pags_dice *dice, float lo, float hi) {
  return lo + (hi - lo) * (float)pags_rng_uniform(dice->seed, dice->stream, dice->count++);
}

/* 0 .. count - 1 */
static inline int pags_dice_pick(pags_dice *dice, int count) {
  return (int)pags_rng_below(dice->seed, dice->stream, dice->count++, (uint64_t)count);
}

#endif
