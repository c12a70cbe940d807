/* SPDX-License-Identifier: Apache-2.0 */
/* Options on the scene that several verbs read: axes of splat files, removed Gaussians, edited objects, and changes to
 * how pictures are drawn. `where` in the macros below: the offset of the options' struct in the verb's. */
#ifndef PAGS_CLI_SCENE_OPTIONS_H
#define PAGS_CLI_SCENE_OPTIONS_H

#include <pags/compose.h>
#include "cli/common/session.h"
#include "scene/filter.h"

/* ---- Axes and up axis of splat files, if the file stores none ---- */

typedef struct pags_reading {
  int axes; /* a pags_axes; 0: as the file says */
  int up;   /* a pags_up; 0: as the file says */
} pags_reading;

/* Rows for a pags_reading. The choices are in the order of pags_axes and pags_up. */
#define PAGS_READING_OPTIONS(where)                                                                             \
  PAGS_CHOICE("up", (where) + offsetof(pags_reading, up), "file|z|-y|y", NULL,                                  \
              "Up axis; \"file\": as stored in the file, -y for splat files that store none."),                 \
      PAGS_CHOICE("axes", (where) + offsetof(pags_reading, axes),                                               \
                  "file|ldb|rdb|lub|rub|ldf|rdf|luf|ruf|lfd|rfd|lfu|rfu|lbd|rbd|lbu|rbu", NULL,                 \
                  "Axes of a splat file: where x, y and z point (left or right, up or down, forward or back); " \
                  "\"file\": as recorded in the .spz, else rub for .spz and rdf (as PLY) for other formats.")

/* Loads a scene with these axes. */
pags_result pags_reading_load(const pags_reading *reading, const char *path, pags_scene *scene);

/* ---- Removed Gaussians ---- */

/* The values of --crop-box, --crop-sphere and --edits as given; those of the other options are in the filter. */
typedef struct pags_crop {
  const char *box, *sphere, *edits;
  pags_filter filter; /* box and ball are set by pags_crop_check */
} pags_crop;

#define PAGS_CROP_OPTIONS(where)                                                                                     \
  PAGS_GROUP("Selection of Gaussians"),                                                                              \
      PAGS_TEXT("crop-box", 0, (where) + offsetof(pags_crop, box), "X,Y,Z,X,Y,Z", "none",                            \
                "Keep only Gaussians in the box between these two corners; metres from the scene's origin, as in "   \
                "exported files."),                                                                                  \
      PAGS_TEXT("crop-sphere", 0, (where) + offsetof(pags_crop, sphere), "X,Y,Z,R", "none",                          \
                "Keep only Gaussians within R metres of this point."),                                               \
      PAGS_VALUE("min-opacity", 0, DOUBLE, (where) + offsetof(pags_crop, filter.least_opacity), 0, 1, "A", "0..1",   \
                 NULL, "Remove Gaussians of lower opacity."),                                                        \
      PAGS_VALUE("min-size", 0, DOUBLE, (where) + offsetof(pags_crop, filter.least_size), 0, PAGS_UNLIMITED, "M",    \
                 "metres, largest sigma", NULL, "Remove smaller Gaussians."),                                        \
      PAGS_VALUE("max-size", 0, DOUBLE, (where) + offsetof(pags_crop, filter.greatest_size), 0, PAGS_UNLIMITED, "M", \
                 "metres, largest sigma; 0: no limit", NULL, "Remove larger Gaussians."),                            \
      PAGS_VALUE("min-views", 0, INT, (where) + offsetof(pags_crop, filter.least_views), 0, 1e9, "N",                \
                 "training views; 0: no limit", NULL, "Remove Gaussians that are in the frame of fewer views."),     \
      PAGS_TEXT("edits", 0, (where) + offsetof(pags_crop, edits), "FILE", "none",                                    \
                "Clean-up and appearance rules, JSON (docs/cleanup.md).")

/* Parses box and sphere. Returns PAGS_EXIT_OK or pags_usage_error. */
int pags_crop_check(const pags_parsed *parsed, pags_crop *crop);

/* Applies the rules of --edits (pags_scene_cleanup), removes Gaussians (pags_scene_filter) and prints how many are
 * left. */
pags_result pags_crop_apply(const pags_crop *crop, pags_scene *scene, double time, uint8_t *chosen,
                            const pags_session *session);

/* ---- Hidden, moved and added objects ---- */

/* The arguments of --without, --move and --add, unparsed, in the order given. */
typedef struct pags_object_edits {
  pags_words without, move, add;
} pags_object_edits;

#define PAGS_EDIT_OPTIONS(where)                                                                                  \
  PAGS_VALUE("without", 0, WORDS, (where) + offsetof(pags_object_edits, without), 0, 0, "OBJECT,...", NULL, NULL, \
             "Hide these objects; repeatable."),                                                                  \
      PAGS_VALUE("move", 0, PAIRS, (where) + offsetof(pags_object_edits, move), 0, 0, "OBJECT X,Y,Z,YAW",         \
                 "metres forward, left, up in the object's frame; degrees to the left", NULL,                     \
                 "Move an object off its track by this offset; also OBJECT=X,Y,Z,YAW; repeatable."),              \
      PAGS_VALUE("add", 0, PAIRS, (where) + offsetof(pags_object_edits, add), 0, 0, "OBJECT X,Y,Z,YAW",           \
                 "as for --move", NULL, "Add a copy of an object at this offset.")

/* Refuses values of --move and --add that aren't of the form X,Y,Z,YAW. Returns PAGS_EXIT_OK or pags_usage_error. */
int pags_object_edits_check(const pags_parsed *parsed, const pags_object_edits *words);

typedef struct pags_edit_list {
  pags_edit *items;
  int64_t count, capacity;
} pags_edit_list;

static inline void pags_edit_list_destroy(pags_edit_list *list) {
  free(list->items);
}

/* Adds the edits of the scene's objects to the list. OBJECT is an object's id, or "class:" followed by a category or a
 * class of the data set, which means every object of it. Fails, naming the OBJECT, if the scene has no such object. */
pags_result pags_object_edits_find(const pags_object_edits *words, const pags_scene *scene, pags_edit_list *list);

/* ---- Changes to how pictures are drawn ---- */

/* The values of --background, --antialiased, --no-antialiased, --near and --low-pass. */
typedef struct pags_picture_changes {
  double background[3], near_plane, low_pass;
  int antialiased;
} pags_picture_changes;

/* Changes what is given on the command line; the rest stays as the scene says. */
void pags_picture_changes_apply(const pags_picture_changes *changes, const pags_parsed *parsed,
                                pags_frame_options *frame);

#endif
