/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the objects of a driving set of its labelled boxes, whichever file they come from. Labels with faults are
 * mended or left out; pags_labels_end says so in one line a kind. */
#ifndef PAGS_DATASET_DRIVING_LABELS_H
#define PAGS_DATASET_DRIVING_LABELS_H

#include "base/log.h"
#include "dataset/driving/driving_set.h"

/* A labelled box: frame and pose of the keyframe, length, width and height in metres. */
typedef struct pags_label {
  pags_keyframe keyframe;
  double size[3];
} pags_label;

typedef struct pags_labels {
  pags_driving *driving;
  const char *source; /* the file, for messages */
  int64_t boxes, ids, capacity;
  pags_tally flat, twice, sized, turned, moved, split, leaping, shaken, unlisted, renamed;
} pags_labels;

/* Adds the object of an id to driving->objects, with a keyframe at each time step used, or several objects if the id
 * goes from one thing to another; none without a box at a time step used. `present`: by time step, whether a list of
 * the frame has the object; NULL: there is no such list. The labels are sorted and changed. */
pags_result pags_labels_take(pags_labels *all, const char *id, const char *class_name, const uint8_t *present,
                             pags_label *labels, int64_t count);

/* Reports what was found and what was mended. A file without any object is reported and does not count as boxes. `of`:
 * added to the note after the number of objects. */
pags_result pags_labels_end(pags_labels *all, const char *of);

#endif
