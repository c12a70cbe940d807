/* SPDX-License-Identifier: Apache-2.0 */
/* Opens the photographs that a scene is compared with, undistorted, shrunk and split as they were for its
 * training. */
#ifndef PAGS_CLI_PHOTOGRAPHS_H
#define PAGS_CLI_PHOTOGRAPHS_H

#include <pags/dataset.h>
#include <pags/image.h>
#include <pags/scene.h>
#include <stdbool.h>

typedef struct pags_photographs_view {
  int64_t index; /* index of the view in the data set */
  int test;
  const pags_scene_view *scene_view; /* the same view in the scene; NULL if the scene records no views */
} pags_photographs_view;

typedef struct pags_photographs {
  pags_dataset *dataset;
  bool borrowed;    /* the data set stays open */
  double downscale; /* factor by which the photographs are shrunk */
  pags_photo_cache *photos;
  int64_t count;
  pags_photographs_view *views; /* the views to compare, in the data set's order */
} pags_photographs;

/* Opens the data set `path`; `scene` must outlive `out`. If the scene records its views, they decide the downscale
 * (from the focal lengths), which views are compared and which of them were held out; a view whose photograph is
 * missing or whose camera differs is an error. But a file that the user named (`given`) may be another part of the
 * capture, such as a transforms_test.json: views of the scene may be missing there, and where none is there all of its
 * views count as held out. If the scene has no views (a bare splat file), `options` decides all
 * of this. */
pags_result pags_photographs_open(const pags_scene *scene, const char *path, const pags_dataset_options *options,
                                  bool given, pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
/* Opens `dataset` or, if it is NULL, the scene's own data set, for a scene that records its views: where its
 * photographs are and how they were opened, unless `options` says it, is what the scene says. */
pags_result pags_photographs_open_for(const pags_scene *scene, const char *dataset, const pags_dataset_options *options,
                                      pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
/* As pags_photographs_open, of all views of a data set that is open already and stays the caller's; view i is the data
 * set's view i. */
pags_result pags_photographs_of(pags_dataset *dataset, pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
void pags_photographs_close(pags_photographs *photographs);

/* The camera that the scene draws views[i] with: the data set's, or the scene's where training has corrected its pose;
 * with a rolling shutter if the scene was trained with it. */
pags_camera pags_photographs_camera(const pags_photographs *photographs, int64_t i);

/* A photograph as F32 RGB in [0, 1]. */
typedef struct pags_photograph {
  pags_image image;
  uint8_t *mask;    /* one byte a pixel; NULL: every pixel counts */
  pags_photo photo; /* the photograph as decoded, with its labels */
} pags_photograph;

/* Reads the photograph of views[i]. out->photo is valid until the next call. */
pags_result pags_photographs_read(pags_photographs *photographs, int64_t i, pags_photograph *out);
void pags_photograph_destroy(pags_photograph *photo); /* a zeroed struct is allowed */

#endif
