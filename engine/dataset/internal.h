/* SPDX-License-Identifier: Apache-2.0 */
/* The structure behind pags_dataset and the functions that the files of this folder share. */
#ifndef PAGS_DATASET_INTERNAL_H
#define PAGS_DATASET_INTERNAL_H

#include <pags/dataset.h>

#include "dataset/block.h"
#include "dataset/parsed.h"

struct pags_dataset {
  char *path, *colmap;
  pags_block_file block;      /* zeroed unless the data set is a block of a recording */
  pags_parsed_dataset parsed; /* owns the strings of `views`; parsed.views has the same order */
  pags_view *views;
  pags_camera *cameras; /* one per view: not downscaled; only size, intrinsics and lens are set (view_camera.c) */
  bool *far;            /* one per view: far_cameras.c */
  int64_t count;
  double origin[3];
  int64_t missing;
  int64_t point_count;
  float *xyz;
  uint8_t *rgb;
  int to_match;       /* there are no points: point_count are to be matched */
  char *image_folder; /* options.image_folder */
  pags_image_alpha image_alpha;
  uint8_t background[3];
};

/* Prepares the lens of view `index` and sets dataset->cameras[index], through which its photographs are trained: the
 * pinhole of pags_lens_pinhole or, unless `undistort`, the lens itself where that pinhole would show less than nine
 * tenths of what the lens sees. *share: the part of the picture (0 to 1) at which the lens can't be inverted, 0 if an
 * earlier view has the same lens. */
pags_result pags_view_camera_choose(pags_dataset *dataset, int64_t index, bool undistort, double *share);

/* Clears the pixels of `mask` (one channel, 255: used) that the lens of `camera` doesn't see, with a margin of a pixel;
 * creates it if some aren't seen and it has no data. A pinhole sees all. */
pags_result pags_view_camera_mask(const pags_camera *camera, pags_image *mask);

/* Finds the far cameras of a static set, those that stand far from all others as those of pictures whose registration
 * failed do, with a warning, then sets the origin: with large coordinates (metres in a map grid) the mean position of
 * the other cameras rounded to whole metres, so that positions relative to it fit single precision; else zero. Call it
 * after the views are made and before the points are. */
pags_result pags_dataset_set_origin(pags_dataset *dataset);

/* Whether the camera of a view is a far one, which says nothing of the size and the middle of the scene. */
bool pags_dataset_is_far(const pags_dataset *dataset, int64_t view);

/* Fills in the initial points of training: those of the parsed data set if it has some, else a number to match
 * (points.c). */
pags_result pags_dataset_make_points(pags_dataset *dataset, const pags_dataset_options *options);

/* Logs a warning if there are points and none of them is in view of any camera (in_view.c). */
void pags_dataset_check_in_view(const pags_dataset *dataset);

/* Finds, for every camera of a driving set, the pixels that show the ego vehicle (ego_mask.c). Call it after the
 * views are made. */
pags_result pags_ego_masks_make(pags_dataset *dataset, const pags_dataset_options *options);

/* A decoded photograph: planes of height * stride bytes in the order R, G, B, mask (if has_mask), labels (if
 * has_labels). */
typedef struct pags_photo_data {
  int width, height, stride;
  bool has_mask, has_labels;
  uint8_t *planes; /* aligned to 64 bytes; freed by the owner */
} pags_photo_data;

void pags_photo_data_destroy(pags_photo_data *photo); /* zeroes it */

/* Decodes the photograph of a view, undistorts it, and shrinks it by `shrink` after the downscale of the data set.
 * May be called from several threads at once. */
pags_result pags_photo_decode(const pags_dataset *dataset, int64_t view, int shrink, pags_photo_data *out);

/* Undistorts a photograph. `from`: 8-bit RGB, of the lens's size. `from_mask`: 8-bit, one channel, the same size, or
 * NULL. `to` and `to_mask` are created here; the caller destroys them, also on failure. A pixel of to_mask is 255 if
 * the pixel has a source and every source pixel with a nonzero weight is >= 128 in from_mask, else 0. to_mask stays
 * empty (data NULL) if there is no from_mask and every pixel has a source. Pixels without a source are black. */
pags_result pags_undistort(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                           const pags_image *from_mask, pags_image *to, pags_image *to_mask);

/* Undistorts a one-channel label image by nearest neighbour; a pixel without a source gets 0. */
pags_result pags_undistort_labels(const pags_lens *lens, const pags_camera *pinhole, const pags_image *from,
                                  pags_image *to);

/* Computes two upper bounds in bytes: `kept` for the finished photograph with mask and labels, `decoding` for all
 * buffers that pags_photo_decode holds while it decodes 8-bit samples, `kept` included. */
void pags_photo_bytes(const pags_dataset *dataset, int64_t view, int shrink, uint64_t *kept, uint64_t *decoding);

/* Returns the bytes that the cache uses now (`used`) and used at most (`peak`), and the number of photographs it has
 * decoded. For tests. */
void pags_photo_cache_figures(const pags_photo_cache *cache, uint64_t *used, uint64_t *peak, uint64_t *decoded);

#endif
