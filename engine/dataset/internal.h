/* SPDX-License-Identifier: Apache-2.0 */
/* The inside of a data set, for the files of this folder. */
#ifndef PAGS_DATASET_INTERNAL_H
#define PAGS_DATASET_INTERNAL_H

#include <pags/dataset.h>

#include "dataset/parsed.h"

struct pags_dataset {
  char *path;
  pags_parsed_dataset parsed; /* owns the strings; its views are in the order of `views` */
  pags_view *views;
  pags_camera *pinholes; /* of each view: undistorted, not downscaled; intrinsics only */
  int64_t count;
  double origin[3];
  int64_t missing;
  int64_t point_count;
  float *xyz;
  uint8_t *rgb;
  int random;
};

/* Fills in the points to start from: the parsed set's, or random ones. */
pags_result pags_dataset_make_points(pags_dataset *dataset, const pags_dataset_options *options);

/* Driving sets: where cameras see their own car. After the views are made. */
pags_result pags_ego_masks_make(pags_dataset *dataset, const pags_dataset_options *options);

/* One photograph in memory: planes of height * stride bytes: R, G, B, then the mask's and the labels' where it has
 * them. */
typedef struct pags_photo_data {
  int width, height, stride;
  bool has_mask, has_labels;
  uint8_t *planes; /* aligned to 64 bytes; freed by the owner */
} pags_photo_data;

/* Reads, undistorts and shrinks; safe on several threads at once. */
pags_result pags_photo_decode(const pags_dataset *dataset, int64_t view, int shrink, pags_photo_data *out);

/* Bytes of the photograph with its mask, and of everything that decoding one (8 bit a sample) holds at once, itself
 * included. */
void pags_photo_bytes(const pags_dataset *dataset, int64_t view, int shrink, uint64_t *kept, uint64_t *decoding);

/* What a cache has in use now and had at most, in bytes, and how many photographs it has decoded. For tests. */
void pags_photo_cache_figures(const pags_photo_cache *cache, uint64_t *used, uint64_t *peak, uint64_t *decoded);

#endif
