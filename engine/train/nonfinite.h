/* SPDX-License-Identifier: Apache-2.0 */
/* Counts the updates that were left out because a gradient or a parameter wasn't finite, and remembers the first, the
 * same for any number of threads and across checkpoints. A number that isn't finite is never written to a parameter
 * or a moment. */
#ifndef PAGS_TRAIN_NONFINITE_H
#define PAGS_TRAIN_NONFINITE_H

#include <stdatomic.h>

#include <pags/base.h>

typedef enum pags_nonfinite_kind {
  PAGS_NONFINITE_GRADIENT,  /* the gradient of a Gaussian: not finite, or so large that its square isn't finite */
  PAGS_NONFINITE_PARAMETER, /* a parameter of a Gaussian */
  PAGS_NONFINITE_POSE,      /* the gradient of a keyframe of an object's track */
  PAGS_NONFINITE_EXPOSURE,  /* the gradient of a view's exposure */
  PAGS_NONFINITE_CAMERA     /* the gradient of a view's camera pose */
} pags_nonfinite_kind;

typedef struct pags_nonfinite_row {
  int64_t step;
  int64_t object; /* object number in the data set, of the model or track; -1: the background */
  int64_t row;    /* row of the model at that step; or keyframe of the track; or view */
  int32_t plane;  /* plane of a Gaussian, as in pags/gaussians.h, Fourier terms from PAGS_MAX_PLANES on; else 0 */
  int32_t kind;   /* pags_nonfinite_kind */
} pags_nonfinite_row;

/* Updates left out, in a step or in the whole run: rows of Gaussians, keyframes' poses, views' exposures. */
typedef struct pags_left_out {
  int64_t count;
  pags_nonfinite_row first;
} pags_left_out;

typedef struct pags_nonfinite {
  int64_t count; /* as of pags_left_out, in the whole run */
  pags_nonfinite_row first;
  atomic_flag busy; /* cleared before the first note */
} pags_nonfinite;

/* Records `count` left-out updates of one step. `first` is the first of them in the order Gaussians, poses,
 * exposures, then by object, row and plane. Safe from several threads. */
void pags_nonfinite_note(pags_nonfinite *nonfinite, int64_t count, const pags_nonfinite_row *first);
/* Describes the first left-out update in one line: what, where, when. `name` is the name of its object; it isn't used
 * for the background. */
enum { PAGS_GUARD_TEXT = 256 };
void pags_nonfinite_describe(const pags_nonfinite *nonfinite, const char *name, char text[PAGS_GUARD_TEXT]);

#endif
