/* SPDX-License-Identifier: Apache-2.0 */
/* Options --without, --move and --add, which hide, move or add objects, and their conversion to the scene's edits. */
#ifndef PAGS_CLI_OBJECT_EDITS_H
#define PAGS_CLI_OBJECT_EDITS_H

#include "cli/common/options.h"

#include <pags/compose.h>

/* The arguments of --without, --move and --add, unparsed, in the order given. */
typedef struct pags_object_edits {
  pags_words without, move, add;
} pags_object_edits;

/* Rows of these three options for a verb's option table; `where` is the offset of a pags_object_edits in the verb's
 * struct. */
#define PAGS_EDIT_OPTIONS(where)                                                                                  \
  PAGS_VALUE("without", 0, WORDS, (where) + offsetof(pags_object_edits, without), 0, 0, "OBJECT,...", NULL, NULL, \
             "Hide these objects; repeatable."),                                                                  \
      PAGS_VALUE("move", 0, PAIRS, (where) + offsetof(pags_object_edits, move), 0, 0, "OBJECT X,Y,Z,YAW",         \
                 "metres forward, left, up in the object's frame; degrees to the left", NULL,                     \
                 "Move an object off its track by this offset; also OBJECT=X,Y,Z,YAW; repeatable."),              \
      PAGS_VALUE("add", 0, PAIRS, (where) + offsetof(pags_object_edits, add), 0, 0, "OBJECT X,Y,Z,YAW",           \
                 "as for --move", NULL, "Add a copy of an object at this offset.")

/* Returns the first value of --move or --add that is not of the form X,Y,Z,YAW; NULL if all are. */
const char *pags_object_edits_misspelt(const pags_object_edits *words);

/* Converts the options' arguments to edits of the scene's objects. OBJECT is an object's id, or "class:" followed by
 * a category or a class of the data set, which means every object of it. Fails, naming the OBJECT, if the scene has
 * no such object. The caller frees `edits`. */
pags_result pags_object_edits_find(const pags_object_edits *words, const pags_scene *scene, pags_edit **edits,
                                   int64_t *count);

#endif
