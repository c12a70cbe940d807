/* SPDX-License-Identifier: Apache-2.0 */
/* Opens the photographs for comparison with a scene, undistorted, downscaled and split as for its training. */
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

/* Returns the options for the scene's photographs: those that aren't set in `options` as in the scene; `dataset` as
 * below. */
pags_dataset_options pags_photographs_options(const pags_scene *scene, const char *dataset,
                                              const pags_dataset_options *options);
/* Opens `dataset`, or the scene's own data set if it is NULL; `scene` must outlive `out`. If the scene stores its
 * views, they determine the downscale factor (from the focal lengths), the compared views and which of them are held
 * out; a missing photograph or a different camera is an error. A `dataset` that is a file, such as a
 * transforms_test.json, may be another part of the capture: views may then be missing, and if all are, every view of
 * the file counts as held out. For a scene without views (a splat file), `options` determines all of this. */
pags_result pags_photographs_open(const pags_scene *scene, const char *dataset, const pags_dataset_options *options,
                                  pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
/* As pags_photographs_open, with pags_photographs_options. */
pags_result pags_photographs_open_for(const pags_scene *scene, const char *dataset, const pags_dataset_options *options,
                                      pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
/* As pags_photographs_open, for all views of an open data set, which remains the caller's; view i is view i of the data
 * set. */
pags_result pags_photographs_of(pags_dataset *dataset, pags_tasks *tasks, uint64_t image_cache, pags_photographs *out);
void pags_photographs_close(pags_photographs *photographs); /* a zeroed struct is allowed */

/* The camera to render views[i] with: the data set's, or the scene's if training corrected its pose; with the rolling
 * shutter of training. */
pags_camera pags_photographs_camera(const pags_photographs *photographs, int64_t i);

/* A photograph as F32 RGB in [0, 1]. */
typedef struct pags_photograph {
  pags_image image;
  uint8_t *mask;    /* one byte per pixel; NULL: all pixels count */
  pags_photo photo; /* the photograph as decoded, with its labels */
} pags_photograph;

/* Reads the photograph of views[i] into a zeroed struct. out->photo is valid until the next call. */
pags_result pags_photographs_read(pags_photographs *photographs, int64_t i, pags_photograph *out);
void pags_photograph_destroy(pags_photograph *photo); /* a zeroed struct is allowed */

#endif
