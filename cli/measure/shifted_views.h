/* SPDX-License-Identifier: Apache-2.0 */
/* Compares renderings with the true pictures from cameras shifted off the recorded path, which synthetic data sets
 * include. */
#ifndef PAGS_CLI_SHIFTED_VIEWS_H
#define PAGS_CLI_SHIFTED_VIEWS_H

#include "cli/common/session.h"

#include <pags/compose.h>

typedef struct pags_shifted_view_score {
  char name[64]; /* name of the folder, such as "right_1" */
  int64_t views;
  double psnr, ssim;  /* means over the views */
  int64_t road_views; /* views with road pixels, according to NNNNN_semantic.png in the same folder */
  double road_psnr;   /* mean over these views of the PSNR of road pixels; NaN without such views */
} pags_shifted_view_score;

typedef struct pags_shifted_view_scores {
  int64_t count;
  pags_shifted_view_score *items; /* sorted by name */
} pags_shifted_view_scores;

/* Renders the cameras of every DATASET/truth/shift/NAME/path.json, `downscale` times smaller, and measures PSNR and
 * SSIM against the pictures in that folder. Fails if the data set has none. With `images` (a folder, may be NULL) also
 * writes NAME_00000_render.png and NAME_00000_truth.png, and so on. */
pags_result pags_shifted_views_measure(const char *dataset, double downscale, pags_composition *composition,
                                       pags_frame *frame, const pags_frame_options *options,
                                       const pags_session *session, const char *images, pags_shifted_view_scores *out);
void pags_shifted_view_scores_destroy(pags_shifted_view_scores *scores); /* for a zeroed struct does nothing */

#endif
