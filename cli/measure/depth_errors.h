/* SPDX-License-Identifier: Apache-2.0 */
/* Errors of rendered depth against LiDAR: gathers them view by view and summarises them. */
#ifndef PAGS_CLI_DEPTH_ERRORS_H
#define PAGS_CLI_DEPTH_ERRORS_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include "base/json.h"

typedef struct pags_depth_errors {
  int64_t count, room;
  double *errors;    /* |rendered - measured|, metres; freed by destroy */
  int64_t within;    /* number of errors that are at most 5 % of the measured depth */
  int64_t unblended; /* number of LiDAR points on pixels without a rendered depth */
} pags_depth_errors;

typedef struct pags_depth_figures {
  int64_t samples;
  double median, mean; /* metres; NaN without samples */
  double mean95;       /* mean of the smallest 95 % of the errors */
  /* Share of the LiDAR points, unblended ones included, whose error is within 5 % of the measured depth. */
  double within;
} pags_depth_figures;

void pags_depth_errors_destroy(pags_depth_errors *errors); /* a zeroed struct is allowed */

/* Adds the depth errors at the LiDAR points of a view's time step. The picture must have its extra channels (depth)
 * and the size of the view's camera; pixels where the mask (one byte a pixel; NULL: no mask) is 0 are left out. */
pags_result pags_depth_errors_add(pags_depth_errors *errors, const pags_dataset *dataset, int64_t view,
                                  const pags_picture *picture, const uint8_t *mask);

/* Appends errors that another rank has gathered. */
pags_result pags_depth_errors_append(pags_depth_errors *errors, const double *more, int64_t count);

/* Summarises all errors; sorts them in place. */
pags_depth_figures pags_depth_errors_figures(pags_depth_errors *errors);
/* Writes the JSON member `depth`: an object, or null without samples. */
void pags_depth_figures_put_json(pags_json_writer *writer, const pags_depth_figures *figures);

#endif
