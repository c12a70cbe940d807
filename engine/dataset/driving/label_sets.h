/* SPDX-License-Identifier: Apache-2.0 */
/* The meaning of the class ids in label images, for the data sets that define them. */
#ifndef PAGS_DATASET_DRIVING_LABEL_SETS_H
#define PAGS_DATASET_DRIVING_LABEL_SETS_H

#include <stdbool.h>

#include <pags/object.h>

typedef struct pags_label_class {
  uint8_t id;
  pags_category category; /* OTHER: not critical by itself */
  const char *name;
} pags_label_class;

typedef struct pags_label_set {
  const char *name;
  int count;
  const pags_label_class *classes; /* ascending ids */
} pags_label_set;

enum { PAGS_LABEL_SETS = 6 };
/* All known label sets; the first, cityscapes, is the default. */
extern const pags_label_set pags_label_sets[PAGS_LABEL_SETS];

/* Finds a label set by its name, which ends at a blank or at the end of the text; NULL if there is no such set. */
const pags_label_set *pags_label_set_find(const char *name);

/* Find a class of a label set by name, ignoring case and punctuation, or by id; NULL if the set has no such class. */
const pags_label_class *pags_label_class_named(const pags_label_set *set, const char *name);
const pags_label_class *pags_label_class_numbered(const pags_label_set *set, int64_t id);

/* Whether two names are equal except for case and punctuation, like "Medium-sized Truck" and "medium sized truck". */
bool pags_same_word(const char *a, const char *b);

#endif
