/* SPDX-License-Identifier: Apache-2.0 */
/* The meaning of the class ids in label images, for the data sets that define them. */
#ifndef PAGS_DATASET_DRIVING_LABEL_SETS_H
#define PAGS_DATASET_DRIVING_LABEL_SETS_H

#include <stdbool.h>

#include <pags/object.h>

typedef struct pags_label_set {
  const char *name;
  int first, count;  /* ids are first to first + count - 1 */
  const char *names; /* of the classes, separated by ", " */
} pags_label_set;

enum { PAGS_LABEL_SETS = 6, PAGS_LABEL_NAME = 48 };
/* All known label sets; the first, cityscapes, is the default. */
extern const pags_label_set pags_label_sets[PAGS_LABEL_SETS];

/* Finds a label set by its name, which ends at a blank or at the end of the text; NULL if there is no such set. */
const pags_label_set *pags_label_set_find(const char *name);

/* Copies the name of a class to `out` and returns it. */
const char *pags_label_name(const pags_label_set *set, int id, char out[PAGS_LABEL_NAME]);
/* Returns the id of the class with this name, ignoring case and punctuation; -1 if the set has none. */
int pags_label_class_named(const pags_label_set *set, const char *name);
/* Whether the set has a class with this id, and the category of that class; OTHER: not critical by itself. */
bool pags_label_set_has(const pags_label_set *set, int64_t id);
pags_category pags_label_category(const pags_label_set *set, int id);

/* Whether two names are equal except for case and punctuation, like "Medium-sized Truck" and "medium sized truck". */
bool pags_same_word(const char *a, const char *b);

#endif
