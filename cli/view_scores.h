/* SPDX-License-Identifier: Apache-2.0 */
/* How near pictures come to photographs, view by view and on the mean, whole and by region. */
#ifndef PAGS_CLI_VIEW_SCORES_H
#define PAGS_CLI_VIEW_SCORES_H

#include "cli/session.h"

#include <pags/dataset.h>
#include <pags/image.h>

/* Regions of a photograph, by its labels. */
typedef enum pags_region {
  PAGS_REGION_WHOLE,
  PAGS_REGION_CRITICAL,
  PAGS_REGION_NONCRITICAL,
  PAGS_REGION_MOVING,
  PAGS_REGION_VEHICLES,
  PAGS_REGION_PEDESTRIANS,
  PAGS_REGION_CYCLISTS,
  PAGS_REGION_COUNT
} pags_region;

typedef struct pags_view_score {
  const char *name;
  int test;
  double psnr[PAGS_REGION_COUNT], ssim[PAGS_REGION_COUNT]; /* NaN: not measured, or no pixel of that kind */
  double lpips, psnr_unexposed; /* NaN: not measured. psnr_unexposed: of the picture as the scene is, where the rest is
                                   as the camera exposes */
} pags_view_score;

pags_view_score pags_view_score_make(const char *name, int test);

/* Which regions each pixel counts in: bit r for region r. `mask` (one byte a pixel) and `labels` (`stride` bytes a row)
 * may be NULL; without labels there is the whole only. */
void pags_regions_fill(int width, int height, const uint8_t *mask, const uint8_t *labels, int stride,
                       uint16_t *regions);

typedef struct pags_mean_score {
  int64_t views;
  pags_view_score mean; /* each over the views where there is something to measure */
} pags_mean_score;

pags_mean_score pags_view_scores_mean(const pags_view_score *scores, int64_t count, int test);

/* Members psnr, ssim, ... of an open object. */
void pags_view_scores_put_json(pags_json_writer *writer, const pags_view_score *score);
/* A line per view and split; then, where a split has regions, a line for each. */
void pags_view_scores_print(const pags_session *session, const pags_view_score *scores, int64_t count);

#endif
