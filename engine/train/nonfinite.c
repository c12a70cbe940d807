/* SPDX-License-Identifier: Apache-2.0 */
/* Counts the updates left out for a number that isn't finite, and describes the first; see nonfinite.h. */
#include "train/nonfinite.h"

#include <stdbool.h>
#include <stdio.h>

#include <pags/gaussians.h>

static bool comes_before(const pags_nonfinite_row *a, const pags_nonfinite_row *b) {
  /* Gaussians come first in a step, then poses, then exposures. */
  static const int stage[] = {[PAGS_NONFINITE_POSE] = 1, [PAGS_NONFINITE_EXPOSURE] = 2, [PAGS_NONFINITE_CAMERA] = 0};
  const int64_t left[] = {a->step, stage[a->kind], a->object, a->row, a->plane};
  const int64_t right[] = {b->step, stage[b->kind], b->object, b->row, b->plane};
  int k = 0;
  while (k < 4 && left[k] == right[k])
    k++;
  return left[k] < right[k];
}

/* Calls are so rare that a spin lock is good enough. The result is a sum and a minimum of integers, so it doesn't
 * depend on the order of the calls. */
void pags_nonfinite_note(pags_nonfinite *nonfinite, int64_t count, const pags_nonfinite_row *first) {
  while (atomic_flag_test_and_set_explicit(&nonfinite->busy, memory_order_acquire)) {
  }
  if (nonfinite->count == 0 || comes_before(first, &nonfinite->first))
    nonfinite->first = *first;
  nonfinite->count += count;
  atomic_flag_clear_explicit(&nonfinite->busy, memory_order_release);
}

void pags_nonfinite_describe(const pags_nonfinite *nonfinite, const char *name, char text[PAGS_GUARD_TEXT]) {
  static const char *const names[PAGS_SH] = {"mean x",       "mean y",       "mean z",       "ln sigma 1",
                                             "ln sigma 2",   "ln sigma 3",   "quaternion w", "quaternion x",
                                             "quaternion y", "quaternion z", "opacity logit"};
  static const char *const channels[3] = {"red", "green", "blue"};
  const pags_nonfinite_row *o = &nonfinite->first;
  const long long row = o->row, step = o->step;
  const bool gaussian = o->kind == PAGS_NONFINITE_GRADIENT || o->kind == PAGS_NONFINITE_PARAMETER;
  char plane[48] = "", model[96] = "the background";
  if (o->object >= 0)
    snprintf(model, sizeof model, "object '%.64s'", name ? name : "");
  const bool fourier = o->plane >= PAGS_MAX_PLANES;
  const int place = o->plane - (fourier ? PAGS_MAX_PLANES : PAGS_SH), coefficient = place / (fourier ? 12 : 3);
  if (gaussian && o->plane < PAGS_SH)
    snprintf(plane, sizeof plane, "%s", names[o->plane]);
  else if (gaussian && fourier)
    snprintf(plane, sizeof plane, "Fourier term %d of colour term %d of %s", 1 + place % 12 / 3, coefficient,
             channels[place % 3]);
  else if (gaussian)
    snprintf(plane, sizeof plane, "colour term %d of %s", coefficient, channels[place % 3]);
  switch ((pags_nonfinite_kind)o->kind) {
    case PAGS_NONFINITE_GRADIENT:
    case PAGS_NONFINITE_PARAMETER:
      snprintf(text, PAGS_GUARD_TEXT, "%s%s of row %lld of %s at step %lld",
               o->kind == PAGS_NONFINITE_GRADIENT ? "the gradient by " : "", plane, row, model, step);
      break;
    case PAGS_NONFINITE_POSE:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by the pose of %s at its keyframe %lld at step %lld", model, row,
               step);
      break;
    case PAGS_NONFINITE_EXPOSURE:
    case PAGS_NONFINITE_CAMERA:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by the %s of view %lld at step %lld",
               o->kind == PAGS_NONFINITE_EXPOSURE ? "exposure" : "camera pose", row, step);
      break;
  }
}
