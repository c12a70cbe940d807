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
  pags_camera *cameras; /* one per view: not downscaled; only size, intrinsics and lens are set (view_camera.h) */
  bool *far;            /* one per view: far_cameras.h */
  int64_t count;
  double origin[3];
  int64_t missing;
  int64_t point_count;
  float *xyz;
  uint8_t *rgb;
  int random;
  char *image_folder; /* options.image_folder */
  pags_image_alpha image_alpha;
  uint8_t background[3];
};

/* Fills in the initial points of training: those of the parsed data set if it has some, else random ones (see
 * points.c). */
pags_result pags_dataset_make_points(pags_dataset *dataset, const pags_dataset_options *options);

/* Logs a warning if none of the points, unless they are random, is in view of any camera (in_view.c). */
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

/* Decodes the photograph of a view, undistorts it, and shrinks it by `shrink` after the downscale of the data set.
 * May be called from several threads at once. */
pags_result pags_photo_decode(const pags_dataset *dataset, int64_t view, int shrink, pags_photo_data *out);

/* Computes two upper bounds in bytes: `kept` for the finished photograph with mask and labels, `decoding` for all
 * buffers that pags_photo_decode holds while it decodes 8-bit samples, `kept` included. */
void pags_photo_bytes(const pags_dataset *dataset, int64_t view, int shrink, uint64_t *kept, uint64_t *decoding);

/* Returns the bytes that the cache uses now (`used`) and used at most (`peak`), and the number of photographs it has
 * decoded. For tests. */
void pags_photo_cache_figures(const pags_photo_cache *cache, uint64_t *used, uint64_t *peak, uint64_t *decoded);

#endif
