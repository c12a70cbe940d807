/* SPDX-License-Identifier: Apache-2.0 */
/* What a number that isn't finite kept from moving: counted, and the first remembered, the same for any number of
 * threads and through checkpoints. Nothing of the kind is ever put into a parameter or a moment. */
#ifndef PAGS_TRAIN_NONFINITE_H
#define PAGS_TRAIN_NONFINITE_H

#include <stdatomic.h>

#include <pags/base.h>

typedef enum pags_offence {
  PAGS_OFFENCE_GRADIENT,  /* of a Gaussian: not finite, or so large that its square isn't */
  PAGS_OFFENCE_PARAMETER, /* of a Gaussian */
  PAGS_OFFENCE_POSE,      /* the gradient of a knot of an object's track */
  PAGS_OFFENCE_EXPOSURE   /* the gradient of a view's exposure */
} pags_offence;

typedef struct pags_offender {
  int64_t step;
  int64_t object; /* of the data set, whose model or track; -1: the background */
  int64_t row;    /* of the model as it was then; knot of the track; view */
  int32_t plane;  /* of a Gaussian: as in pags/gaussians.h, Fourier terms from PAGS_MAX_PLANES on; else 0 */
  int32_t kind;   /* pags_offence */
} pags_offender;

typedef struct pags_nonfinite {
  int64_t count; /* over the whole run: updates left out, a row or what stands for one each */
  pags_offender first;
  atomic_flag busy;
} pags_nonfinite;

/* An empty one. */
void pags_nonfinite_init(pags_nonfinite *guard);
/* `count` offences of one step, of which `first` comes first by (object, kind of thing, row). Safe from several
 * threads. */
void pags_nonfinite_note(pags_nonfinite *guard, int64_t count, const pags_offender *first);
/* One line about the first offender: what, where, when. `name`: of the object; not looked at for the background. */
enum { PAGS_GUARD_TEXT = 256 };
void pags_nonfinite_describe(const pags_nonfinite *guard, const char *name, char text[PAGS_GUARD_TEXT]);

#endif
