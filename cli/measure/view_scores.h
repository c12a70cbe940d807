/* SPDX-License-Identifier: Apache-2.0 */
/* Scores of rendered views against their photographs: PSNR, SSIM and LPIPS per view, of the whole picture and by
 * region, and their means. */
#ifndef PAGS_CLI_VIEW_SCORES_H
#define PAGS_CLI_VIEW_SCORES_H

#include "cli/common/photographs.h"
#include "cli/common/session.h"

#include <pags/eval.h>
#include <pags/image.h>

/* Regions of a photograph, defined by its pixel labels. */
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
  double psnr[PAGS_REGION_COUNT], ssim[PAGS_REGION_COUNT]; /* NaN: not measured, or no pixel of that region */
  /* NaN: not measured. psnr_unexposed: without the exposure of the camera, which the other scores include */
  double lpips, psnr_unexposed;
  /* right half of the picture, with the given pose and with the pose fitted to the left half; NaN: not measured */
  double psnr_right, psnr_right_fitted;
} pags_view_score;

pags_view_score pags_view_score_make(const char *name, int test);

/* Computes PSNR and SSIM of each region from the rendering (F32) and the photograph. */
pags_result pags_view_score_measure(const pags_image *render, const pags_photograph *photograph, pags_tasks *tasks,
                                    pags_view_score *score);

/* Loads weights of LPIPS: of the file `given`; if that is NULL, of lpips_alex.npz in the user's data folder
 * (pags_port_data_folder), if it is there; none if it is "none". *out is NULL without weights. */
pags_result pags_view_lpips_load(const char *given, pags_lpips **out);
/* Computes the view's LPIPS. Pixels of the rendering that the photograph masks are replaced by the photograph's, since
 * LPIPS has no mask. Pictures that are too small for the network have none. */
pags_result pags_view_score_lpips(const pags_lpips *lpips, pags_image *render, const pags_photograph *photograph,
                                  pags_tasks *tasks, pags_view_score *score);

typedef struct pags_mean_score {
  int64_t views;
  pags_view_score mean; /* the mean of each score over the views in which it was measured */
} pags_mean_score;

pags_mean_score pags_view_scores_mean(const pags_view_score *scores, int64_t count, int test);

/* Writes the members psnr, ssim, ... into an open JSON object. */
void pags_view_scores_put_json(pags_json_writer *writer, const pags_view_score *score);
/* Prints one line per view; then, for each split, one line for its mean and one for each region that occurs. */
void pags_view_scores_print(const pags_session *session, const pags_view_score *scores, int64_t count);

#endif
