/* SPDX-License-Identifier: Apache-2.0 */
/* Splits that a data set states: which of its views are for training and which are held out. */
#ifndef PAGS_DATASET_SPLITS_H
#define PAGS_DATASET_SPLITS_H

#include "base/json.h"
#include "dataset/parsed.h"

/* The lists train_filenames, val_filenames and test_filenames of a transforms.json (nerfstudio). */
typedef struct pags_split_lists {
  int64_t count;
  struct pags_split_name *names; /* sorted; NULL: no list is given */
  bool trains;                   /* train_filenames is given: what is in no list is left out */
  int64_t left_out;              /* views in no list */
  char *first_left_out;
} pags_split_lists;

/* Zeroed at first; freed by pags_split_lists_end. */
pags_result pags_split_lists_read(const pags_json *json, const pags_json_value *root, pags_split_lists *out);
/* Returns the split of the picture `name` and counts it. */
pags_split pags_split_of(pags_split_lists *lists, const char *name);
/* Warns of names that no picture has and of pictures in no list, and frees the lists. */
void pags_split_lists_end(pags_split_lists *lists, const char *source);

/* Follows a list of held-out pictures, one a line, if there is one: MODEL/test.txt as INRIA's trainer reads it, or
 * ROOT/test_list.txt as nerfbaselines writes it. */
pags_result pags_split_read_text(const char *root, const char *model, pags_parsed_dataset *parsed);

#endif
