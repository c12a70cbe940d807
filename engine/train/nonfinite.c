/* SPDX-License-Identifier: Apache-2.0 */
/* Counts the updates left out for a number that isn't finite, and describes the first; see nonfinite.h. */
#include "train/nonfinite.h"

#include <stdbool.h>
#include <stdio.h>

#include <pags/gaussians.h>

/* Returns the place of an update in a step: 0 for Gaussians, 1 for poses, 2 for exposures. */
static int stage_of(const pags_nonfinite_row *o) {
  return o->kind == PAGS_NONFINITE_EXPOSURE ? 2 : o->kind == PAGS_NONFINITE_POSE;
}

static bool comes_before(const pags_nonfinite_row *a, const pags_nonfinite_row *b) {
  if (a->step != b->step)
    return a->step < b->step;
  if (stage_of(a) != stage_of(b))
    return stage_of(a) < stage_of(b);
  if (a->object != b->object)
    return a->object < b->object;
  if (a->row != b->row)
    return a->row < b->row;
  return a->plane < b->plane;
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

static void name_plane(int plane, char text[48]) {
  static const char *const names[PAGS_SH] = {"mean x",       "mean y",       "mean z",       "ln sigma 1",
                                             "ln sigma 2",   "ln sigma 3",   "quaternion w", "quaternion x",
                                             "quaternion y", "quaternion z", "opacity logit"};
  static const char *const channels[3] = {"red", "green", "blue"};
  if (plane < PAGS_SH)
    snprintf(text, 48, "%s", names[plane]);
  else if (plane < PAGS_MAX_PLANES)
    snprintf(text, 48, "colour term %d of %s", (plane - PAGS_SH) / 3, channels[(plane - PAGS_SH) % 3]);
  else
    snprintf(text, 48, "Fourier term %d of %s", 1 + (plane - PAGS_MAX_PLANES) / 3,
             channels[(plane - PAGS_MAX_PLANES) % 3]);
}

void pags_nonfinite_describe(const pags_nonfinite *nonfinite, const char *name, char text[PAGS_GUARD_TEXT]) {
  const pags_nonfinite_row *o = &nonfinite->first;
  char plane[48] = "", model[96] = "the background";
  if (o->object >= 0)
    snprintf(model, sizeof model, "object '%.64s'", name ? name : "");
  if (o->kind == PAGS_NONFINITE_GRADIENT || o->kind == PAGS_NONFINITE_PARAMETER)
    name_plane(o->plane, plane);
  switch ((pags_nonfinite_kind)o->kind) {
    case PAGS_NONFINITE_GRADIENT:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by %s of row %lld of %s at step %lld", plane, (long long)o->row,
               model, (long long)o->step);
      break;
    case PAGS_NONFINITE_PARAMETER:
      snprintf(text, PAGS_GUARD_TEXT, "%s of row %lld of %s at step %lld", plane, (long long)o->row, model,
               (long long)o->step);
      break;
    case PAGS_NONFINITE_POSE:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by the pose of %s at its keyframe %lld at step %lld", model,
               (long long)o->row, (long long)o->step);
      break;
    case PAGS_NONFINITE_EXPOSURE:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by the exposure of view %lld at step %lld", (long long)o->row,
               (long long)o->step);
      break;
    case PAGS_NONFINITE_CAMERA:
      snprintf(text, PAGS_GUARD_TEXT, "the gradient by the camera pose of view %lld at step %lld", (long long)o->row,
               (long long)o->step);
      break;
  }
}
