/* SPDX-License-Identifier: Apache-2.0 */
/* Makes objects of labelled boxes (labels.h). */
#include "dataset/driving/labels.h"

#include "base/memory.h"
#include "base/sort.h"
#include "base/text.h"
#include "base/vec3.h"
#include "dataset/driving/motion.h"
#include "scene/object.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Metres: a box with a shorter side has no size. Some programs write 0 for the two-wheelers of CARLA, others 1e-6 so as
 * not to divide by it. */
static const double least_side = 0.01;

/* ---- Boxes that are left out ---- */

static int by_frame(const void *a, const void *b) {
  return ((const pags_label *)a)->keyframe.frame - ((const pags_label *)b)->keyframe.frame;
}

/* The time of a frame in seconds: of its time step; between two steps in proportion, beyond them at the usual rate. */
static double time_of(const pags_driving *driving, int frame) {
  int64_t low = 0, high = driving->step_count - 1; /* the steps before and behind, or the two at an end */
  while (high - low > 1) {
    const int64_t middle = (low + high) / 2;
    *(driving->steps[middle].frame <= frame ? &low : &high) = middle;
  }
  const pags_time_step *a = &driving->steps[low], *b = &driving->steps[high];
  if (frame <= a->frame)
    return a->time + (frame - a->frame) / driving->fps;
  if (frame >= b->frame)
    return b->time + (frame - b->frame) / driving->fps;
  return a->time + (b->time - a->time) * (frame - a->frame) / (b->frame - a->frame);
}

static double distance(const pags_keyframe *a, const pags_keyframe *b) {
  return pags_pose_distance(a->world_from_object, b->world_from_object);
}

/* Sorts the labels by frame and leaves out those without a size and all but one of a frame: that which is nearest to
 * the label before, or the first. Returns how many are left. */
static int64_t sort_out(pags_labels *all, const pags_object *object, pags_label *labels, int64_t count) {
  int64_t kept = 0, usable = 0;
  for (int64_t i = 0; i < count; i++) {
    pags_label *label = &labels[i];
    label->keyframe.time = time_of(all->driving, label->keyframe.frame);
    if (fmin(fmin(label->size[0], label->size[1]), label->size[2]) < least_side)
      pags_tally_add(&all->flat, "%s '%s' in frame %d", object->class_name, object->id, label->keyframe.frame);
    else
      labels[usable++] = *label;
  }
  pags_sort(labels, usable, sizeof *labels, by_frame);
  for (int64_t i = 0; i < usable; i++) {
    pags_label *last = kept ? &labels[kept - 1] : NULL;
    if (!last || last->keyframe.frame != labels[i].keyframe.frame) {
      labels[kept++] = labels[i];
      continue;
    }
    pags_tally_add(&all->twice, "%s '%s' in frame %d", object->class_name, object->id, last->keyframe.frame);
    if (kept > 1 && distance(&labels[kept - 2].keyframe, &labels[i].keyframe) <
                        distance(&labels[kept - 2].keyframe, &last->keyframe))
      *last = labels[i];
  }
  return kept;
}

/* ---- Boxes that are mended ---- */

/* Gives a box the extents that its object has in the middle of all labels where its own are three times or a third of
 * them, since an object's size is the mean of its labels'. */
static pags_result mend_sizes(pags_labels *all, const pags_object *object, pags_label *labels, int64_t count) {
  PAGS_AUTOFREE double *sorted = malloc(((size_t)count + 1) * sizeof *sorted);
  PAGS_CHECK_MEMORY(sorted, "%s", all->source);
  double middle[3];
  for (int k = 0; k < 3 && count; k++) {
    for (int64_t i = 0; i < count; i++)
      sorted[i] = labels[i].size[k];
    pags_sort_doubles(sorted, count);
    middle[k] = sorted[count / 2];
  }
  for (int64_t i = 0; i < count && count > 2; i++) {
    bool wrong = false;
    for (int k = 0; k < 3; k++)
      if (labels[i].size[k] > 3 * middle[k] || labels[i].size[k] < middle[k] / 3) {
        labels[i].size[k] = middle[k];
        wrong = true;
      }
    if (wrong)
      pags_tally_add(&all->sized, "%s '%s' in frame %d", object->class_name, object->id, labels[i].keyframe.frame);
  }
  return PAGS_OK;
}

/* Mends the poses of the boxes, counts what was done, and finds out whether the object moves: from all its labels, so
 * that the result doesn't depend on the time steps used. */
static void mend_poses(pags_labels *all, pags_object *whole, pags_label *labels, uint8_t *mended) {
  pags_track_mend(whole, mended);
  for (int64_t i = 0; i < whole->keyframe_count; i++) {
    labels[i].keyframe = whole->keyframes[i];
    if (mended[i])
      pags_tally_add(mended[i] & PAGS_MENDED_MOVED ? &all->moved : &all->turned, "%s '%s' in frame %d",
                     whole->class_name, whole->id, labels[i].keyframe.frame);
  }
  const pags_track_leap leap = pags_track_find_leap(whole);
  if (leap.metres > 0)
    pags_tally_add(&all->leaping, "%s '%s' from frame %d to %d, %.2f m off in %.2f s", whole->class_name, whole->id,
                   whole->keyframes[leap.keyframe].frame, whole->keyframes[leap.keyframe + 1].frame, leap.metres,
                   leap.seconds);
  pags_object_classify_motion(whole);
  if (pags_object_jitters(whole) && !whole->moving)
    pags_tally_add(&all->shaken, "%s '%s'", whole->class_name, whole->id);
}

/* ---- Objects ---- */

static const pags_object *object_of_id(const pags_driving *driving, const char *id) {
  for (int64_t i = 0; i < driving->object_count; i++)
    if (strcmp(driving->objects[i].id, id) == 0)
      return &driving->objects[i];
  return NULL;
}

/* Ids must be unique. Those of per-class trackers are within a class only, whose name is then added. */
static pags_result check_id(pags_labels *all, pags_object *object) {
  const pags_object *other = object_of_id(all->driving, object->id);
  if (!other)
    return PAGS_OK;
  PAGS_AUTOFREE char *longer = pags_text_format("%s-%s", object->id, object->class_name);
  PAGS_CHECK_MEMORY(longer, "%s", all->source);
  if (strcmp(other->class_name, object->class_name) == 0 || object_of_id(all->driving, longer))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: the id '%s' occurs twice, both times of a %s; expected unique ids",
                     all->source, object->id, object->class_name);
  pags_tally_add(&all->renamed, "'%s', of a %s and a %s", object->id, other->class_name, object->class_name);
  free(object->id);
  object->id = pags_take(&longer);
  return PAGS_OK;
}

/* Makes the keyframes of the labels at the time steps used. */
static void use_labels(pags_labels *all, const uint8_t *present, const pags_label *labels, int64_t count,
                       pags_object *object) {
  const pags_driving *driving = all->driving;
  for (int64_t i = 0; i < count; i++) {
    const int64_t step = pags_driving_step(driving, labels[i].keyframe.frame);
    if (step < 0)
      continue;
    if (present && !present[step]) {
      pags_tally_add(&all->unlisted, "%s '%s' in frame %d", object->class_name, object->id, labels[i].keyframe.frame);
      continue;
    }
    pags_keyframe *keyframe = &object->keyframes[object->keyframe_count];
    *keyframe = labels[i].keyframe;
    keyframe->trained = !driving->steps[step].test;
    keyframe->time = driving->steps[step].time;
    /* The size of an object is the mean of its labelled sizes, as a running mean that leaves equal sizes
     * bit-identical. */
    for (int k = 0; k < 3; k++)
      object->size[k] = object->keyframe_count == 0 ? labels[i].size[k]
                                                    : object->size[k] + (labels[i].size[k] - object->size[k]) /
                                                                            (double)(object->keyframe_count + 1);
    object->keyframe_count++;
  }
}

static void take_keyframes(pags_object *whole, const pags_label *labels, int64_t count) {
  for (int64_t i = 0; i < count; i++)
    whole->keyframes[i] = labels[i].keyframe;
  whole->keyframe_count = count;
}

/* Makes the object of the labels of one thing. `whole` has its id, class and room for all keyframes. */
static pags_result take_thing(pags_labels *all, const uint8_t *present, pags_label *labels, int64_t count,
                              uint8_t *mended, pags_object *whole) {
  pags_driving *driving = all->driving;
  PAGS_AUTO(pags_object_destroy) pags_object object = {.category = whole->category};
  object.id = pags_text_copy(whole->id);
  object.class_name = pags_text_copy(whole->class_name);
  object.keyframes = calloc((size_t)count, sizeof *object.keyframes);
  PAGS_CHECK_MEMORY(object.id && object.class_name && object.keyframes, "%s", all->source);
  PAGS_TRY(mend_sizes(all, whole, labels, count));
  take_keyframes(whole, labels, count);
  mend_poses(all, whole, labels, mended);
  object.moving = whole->moving;
  use_labels(all, present, labels, count, &object);
  if (object.keyframe_count == 0)
    return PAGS_OK;
  PAGS_TRY(check_id(all, &object));
  PAGS_CHECK_MEMORY(pags_grow(&driving->objects, driving->object_count + 1, &all->capacity, sizeof object), "%s",
                    all->source);
  driving->objects[driving->object_count++] = object;
  object = (pags_object){0};
  return PAGS_OK;
}

/* What is known of each label of an id. */
typedef struct work {
  int *part;          /* the thing that it is of */
  uint8_t *mended;    /* PAGS_MENDED_* */
  double *scratch;    /* two numbers a label */
  pags_label *labels; /* those of one thing, and what was done to them */
  uint8_t *mended_of_one;
} work;

static void work_destroy(work *w) {
  free(w->part);
  free(w->mended);
  free(w->scratch);
  free(w->labels);
  free(w->mended_of_one);
}

/* Takes the things that an id goes along with. */
static pags_result take_things(pags_labels *all, const uint8_t *present, const pags_label *labels, int64_t count,
                               work *w, pags_object *whole) {
  take_keyframes(whole, labels, count);
  const int parts = pags_track_split(whole, w->part, w->mended, w->scratch);
  if (parts > 1)
    pags_tally_add(&all->split, "%s '%s', to %d things", whole->class_name, whole->id, parts);
  PAGS_AUTOFREE char *id = pags_text_copy(whole->id);
  PAGS_CHECK_MEMORY(id, "%s", all->source);
  for (int p = 0; p < parts; p++) {
    int64_t n = 0;
    for (int64_t i = 0; i < count; i++)
      if (w->part[i] == p) {
        w->labels[n] = labels[i];
        w->mended_of_one[n++] = w->mended[i];
      }
    if (p) {
      free(whole->id);
      whole->id = pags_text_format("%s-part%d", id, p + 1);
      PAGS_CHECK_MEMORY(whole->id, "%s", all->source);
    }
    PAGS_TRY(take_thing(all, present, w->labels, n, w->mended_of_one, whole));
  }
  return PAGS_OK;
}

pags_result pags_labels_take(pags_labels *all, const char *id, const char *class_name, const uint8_t *present,
                             pags_label *labels, int64_t count) {
  const size_t room = (size_t)count + 1;
  PAGS_AUTO(pags_object_destroy)
  pags_object whole = {.id = pags_text_copy(id),
                       .class_name = pags_text_copy(class_name),
                       .category = pags_category_of(class_name),
                       .keyframes = calloc(room, sizeof *whole.keyframes)};
  PAGS_AUTO(work_destroy)
  work w = {calloc(room, sizeof *w.part), calloc(room, 1), calloc(2 * room, sizeof *w.scratch),
            calloc(room, sizeof *w.labels), calloc(room, 1)};
  PAGS_CHECK_MEMORY(whole.id && whole.class_name && whole.keyframes, "%s", all->source);
  PAGS_CHECK_MEMORY(w.part && w.mended && w.scratch && w.labels && w.mended_of_one, "%s", all->source);
  all->ids++;
  all->boxes += count;
  count = sort_out(all, &whole, labels, count);
  return count > 0 ? take_things(all, present, labels, count, &w, &whole) : PAGS_OK;
}

/* ---- What is said ---- */

static void warn(const pags_labels *all) {
  const struct {
    const pags_tally *tally;
    int64_t of;
    const char *what;
  } kinds[] = {
      {&all->flat, all->boxes, "boxes are left out, as a side is shorter than 0.01 m"},
      {&all->twice, all->boxes, "boxes are left out, as their object has another in the same frame"},
      {&all->sized, all->boxes,
       "boxes are three times as large as their object's others, or a third, and got their size"},
      {&all->turned, all->boxes, "boxes are turned against most others of their object and were turned back"},
      {&all->moved, all->boxes, "boxes lie aside of those before and after and were put between them"},
      {&all->unlisted, all->boxes, "boxes are left out, as frame_instances.json doesn't list them"},
      {&all->split, all->ids, "ids go from one thing to another, which are taken as objects of their own (ID-part2)"},
      {&all->shaken, all->ids,
       "objects have boxes that jitter by more than 0.5 m about one place, and are taken as parked"}};
  for (size_t i = 0; i < sizeof kinds / sizeof *kinds; i++)
    if (kinds[i].tally->count)
      PAGS_WARN("%s: %lld of %lld %s; the first is %s", all->source, (long long)kinds[i].tally->count,
                (long long)kinds[i].of, kinds[i].what, kinds[i].tally->first);
  if (all->leaping.count)
    PAGS_WARN(
        "%s: the boxes of %lld of %lld objects leap as nothing does that moves, so some may be wrong; the first is %s",
        all->source, (long long)all->leaping.count, (long long)all->ids, all->leaping.first);
  if (all->renamed.count)
    PAGS_WARN("%s: %lld ids are used in several classes, the class was added to them; the first is %s", all->source,
              (long long)all->renamed.count, all->renamed.first);
}

pags_result pags_labels_end(pags_labels *all, const char *of) {
  pags_driving *driving = all->driving;
  int64_t moving = 0;
  warn(all);
  for (int64_t i = 0; i < driving->object_count; i++)
    moving += driving->objects[i].moving;
  if (driving->object_count > 0)
    driving->provides |= PAGS_PROVIDES_BOXES;
  else
    PAGS_WARN(
        "%s: none of its %lld objects has a box at a time step used: the set is taken as one without boxes; delete the "
        "file if it has none",
        all->source, (long long)all->ids);
  return pags_driving_note(driving, "boxes: %lld objects%s, %lld of them moving", (long long)driving->object_count, of,
                           (long long)moving);
}
