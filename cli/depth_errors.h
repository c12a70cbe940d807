/* SPDX-License-Identifier: Apache-2.0 */
/* Rendered depth beside LiDAR. */
#ifndef PAGS_CLI_DEPTH_ERRORS_H
#define PAGS_CLI_DEPTH_ERRORS_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include "base/json.h"

typedef struct pags_depth_errors {
  int64_t count, room;
  double *errors;    /* |rendered - measured|, metres; freed by destroy */
  int64_t within;    /* of them, at most 5 % of the measured depth */
  int64_t unblended; /* points on pixels where nothing was drawn */
} pags_depth_errors;

typedef struct pags_depth_figures {
  int64_t samples;
  double median, mean; /* metres; NaN without samples */
  double mean95;       /* of the smallest 95 % */
  double within;       /* share of the samples within 5 % of the measured depth */
} pags_depth_figures;

void pags_depth_errors_destroy(pags_depth_errors *errors); /* a zeroed struct is allowed */

/* Adds what the LiDAR of a view's time step says. The picture, with its extra channels, has the size of the view's
 * camera; pixels where the mask (one byte a pixel, NULL: none) is 0 are left out. */
pags_result pags_depth_errors_add(pags_depth_errors *errors, const pags_dataset *dataset, int64_t view,
                                  const pags_picture *picture, const uint8_t *mask);

/* Sorts the errors. */
pags_depth_figures pags_depth_errors_figures(pags_depth_errors *errors);
/* An object `depth`, or null. */
void pags_depth_figures_put_json(pags_json_writer *writer, const pags_depth_figures *figures);

#endif
