/* SPDX-License-Identifier: Apache-2.0 */
/* Options for splat files: axes and up axis, if the file stores none. */
#ifndef PAGS_CLI_READING_H
#define PAGS_CLI_READING_H

#include <pags/scene.h>

#include "cli/common/options.h"

typedef struct pags_reading {
  int axes; /* a pags_axes; 0: as the file says */
  int up;   /* a pags_up; 0: as the file says */
} pags_reading;

/* Rows for a pags_reading at offset `where`. The choices are in the order of pags_axes and pags_up. */
#define PAGS_READING_OPTIONS(where)                                                                             \
  PAGS_CHOICE("up", (where) + offsetof(pags_reading, up), "file|z|-y|y", NULL,                                  \
              "Up axis; \"file\": as stored in the file, -y for splat files that store none."),                 \
      PAGS_CHOICE("axes", (where) + offsetof(pags_reading, axes),                                               \
                  "file|ldb|rdb|lub|rub|ldf|rdf|luf|ruf|lfd|rfd|lfu|rfu|lbd|rbd|lbu|rbu", NULL,                 \
                  "Axes of a splat file: where x, y and z point (left or right, up or down, forward or back); " \
                  "\"file\": as recorded in the .spz, else rub for .spz and rdf (as PLY) for other formats.")

/* Applies the options to a scene that was loaded with these axes. */
static inline void pags_reading_apply(const pags_reading *reading, pags_scene *scene) {
  if (reading->up)
    scene->up = (pags_up)reading->up;
}

#endif
