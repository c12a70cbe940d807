/* SPDX-License-Identifier: Apache-2.0 */
/* Options that remove Gaussians: --crop-box, --crop-sphere, --min-opacity, --min-size, --max-size, --min-views,
 * --edits. */
#ifndef PAGS_CLI_CROP_H
#define PAGS_CLI_CROP_H

#include "cli/common/options.h"
#include "cli/common/session.h"
#include "scene/filter.h"

/* The options' arguments; box and sphere as given. */
typedef struct pags_crop {
  const char *box, *sphere, *edits;
  double least_opacity, least_size, greatest_size;
  int least_views;
} pags_crop;

/* Rows of these options for a verb's option table; `where` is the offset of a pags_crop in the verb's struct. */
#define PAGS_CROP_OPTIONS(where)                                                                                   \
  PAGS_GROUP("Selection of Gaussians"),                                                                            \
      PAGS_TEXT("crop-box", 0, (where) + offsetof(pags_crop, box), "X,Y,Z,X,Y,Z", "none",                          \
                "Keep only Gaussians in the box between these two corners; metres from the scene's origin, as in " \
                "exported files."),                                                                                \
      PAGS_TEXT("crop-sphere", 0, (where) + offsetof(pags_crop, sphere), "X,Y,Z,R", "none",                        \
                "Keep only Gaussians within R metres of this point."),                                             \
      PAGS_VALUE("min-opacity", 0, DOUBLE, (where) + offsetof(pags_crop, least_opacity), 0, 1, "A", "0..1", NULL,  \
                 "Remove Gaussians of lower opacity."),                                                            \
      PAGS_VALUE("min-size", 0, DOUBLE, (where) + offsetof(pags_crop, least_size), 0, PAGS_UNLIMITED, "M",         \
                 "metres, largest sigma", NULL, "Remove smaller Gaussians."),                                      \
      PAGS_VALUE("max-size", 0, DOUBLE, (where) + offsetof(pags_crop, greatest_size), 0, PAGS_UNLIMITED, "M",      \
                 "metres, largest sigma; 0: no limit", NULL, "Remove larger Gaussians."),                          \
      PAGS_VALUE("min-views", 0, INT, (where) + offsetof(pags_crop, least_views), 0, 1e9, "N",                     \
                 "training views; 0: no limit", NULL, "Remove Gaussians that are in the frame of fewer views."),   \
      PAGS_TEXT("edits", 0, (where) + offsetof(pags_crop, edits), "FILE", "none",                                  \
                "Clean-up and appearance rules, JSON (docs/cleanup.md).")

/* Converts the arguments. Returns the first invalid one, and the expected form in `expected`; NULL if all are valid. */
const char *pags_crop_parse(const pags_crop *crop, pags_filter *out, const char **expected);

/* Applies the rules of --edits (pags_scene_cleanup), removes Gaussians (pags_scene_filter) and prints how many are
 * left. */
pags_result pags_crop_apply(const pags_crop *crop, pags_scene *scene, double time, uint8_t *chosen,
                            const pags_session *session);

#endif
