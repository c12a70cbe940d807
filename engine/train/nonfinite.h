/* SPDX-License-Identifier: Apache-2.0 */
/* What a number that isn't finite kept from moving: counted, and the first remembered, the same for any number of
 * threads and through checkpoints. Nothing of the kind is ever put into a parameter or a moment. */
#ifndef PAGS_TRAIN_NONFINITE_H
#define PAGS_TRAIN_NONFINITE_H

#include <stdatomic.h>

#include <pags/base.h>

typedef enum pags_nonfinite_kind {
  PAGS_NONFINITE_GRADIENT,  /* of a Gaussian: not finite, or so large that its square isn't */
  PAGS_NONFINITE_PARAMETER, /* of a Gaussian */
  PAGS_NONFINITE_POSE,      /* the gradient of a knot of an object's track */
  PAGS_NONFINITE_EXPOSURE   /* the gradient of a view's exposure */
} pags_nonfinite_kind;

typedef struct pags_nonfinite_row {
  int64_t step;
  int64_t object; /* of the data set, whose model or track; -1: the background */
  int64_t row;    /* of the model as it was then; knot of the track; view */
  int32_t plane;  /* of a Gaussian: as in pags/gaussians.h, Fourier terms from PAGS_MAX_PLANES on; else 0 */
  int32_t kind;   /* pags_offence */
} pags_nonfinite_row;

typedef struct pags_nonfinite {
  int64_t count; /* over the whole run: updates left out, a row or what stands for one each */
  pags_nonfinite_row first;
  atomic_flag busy;
} pags_nonfinite;

/* An empty one. */
void pags_nonfinite_init(pags_nonfinite *nonfinite);
/* `count` offences of one step, of which `first` comes first by (object, kind of thing, row). Safe from several
 * threads. */
void pags_nonfinite_note(pags_nonfinite *nonfinite, int64_t count, const pags_nonfinite_row *first);
/* One line about the first offender: what, where, when. `name`: of the object; not looked at for the background. */
enum { PAGS_GUARD_TEXT = 256 };
void pags_nonfinite_describe(const pags_nonfinite *nonfinite, const char *name, char text[PAGS_GUARD_TEXT]);

#endif
