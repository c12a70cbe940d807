/* SPDX-License-Identifier: Apache-2.0 */
/* Objects that the command line hides, moves or adds. */
#ifndef PAGS_CLI_OBJECT_EDITS_H
#define PAGS_CLI_OBJECT_EDITS_H

#include "cli/options.h"

#include <pags/compose.h>

/* What --without, --move and --add gathered. */
typedef struct pags_object_edits {
  pags_words without, move, add;
} pags_object_edits;

/* Rows for a verb's table; `where` is the offset of a pags_object_edits. */
#define PAGS_EDIT_OPTIONS(where)                                                                                  \
  PAGS_VALUE("without", 0, WORDS, (where) + offsetof(pags_object_edits, without), 0, 0, "OBJECT,...", NULL, NULL, \
             "leave out these objects; may be given again"),                                                      \
      PAGS_VALUE("move", 0, PAIRS, (where) + offsetof(pags_object_edits, move), 0, 0, "OBJECT X,Y,Z,YAW",         \
                 "metres forward, left, up in its own frame; degrees to the left", NULL,                          \
                 "draw an object elsewhere, along its track; also OBJECT=X,Y,Z,YAW; may be given again"),         \
      PAGS_VALUE("add", 0, PAIRS, (where) + offsetof(pags_object_edits, add), 0, 0, "OBJECT X,Y,Z,YAW",           \
                 "as for --move", NULL, "draw an object there as well")

/* NULL, or what of --move or --add is not X,Y,Z,YAW. */
const char *pags_object_edits_misspelt(const pags_object_edits *words);

/* The edits that the words stand for, in the scene's objects. An OBJECT is an id, or "class:" and a category or a class
 * of the data set (all of them). An error names what the scene doesn't have. `edits` is freed by the caller. */
pags_result pags_object_edits_find(const pags_object_edits *words, const pags_scene *scene, pags_edit **edits,
                                   int64_t *count);

#endif
