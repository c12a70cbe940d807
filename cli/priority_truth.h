/* SPDX-License-Identifier: Apache-2.0 */
/* Priorities beside the truth of synthetic streets: does what shows something critical score high, and nothing else? */
#ifndef PAGS_CLI_PRIORITY_TRUTH_H
#define PAGS_CLI_PRIORITY_TRUTH_H

#include "cli/photographs.h"

#include <pags/compose.h>
#include "base/json.h"

/* A Gaussian's owner is the nearest true surface at the time of the training view that shows it most. Seen are those
 * whose weights alpha T over all training views sum up to a pixel; counted those of them whose mean lies within 5 cm of
 * the owner and over 15 cm from any surface of the other kind. */
typedef struct pags_priority_truth {
  int64_t seen, counted;   /* 0 seen: there is no truth */
  int64_t astray, between; /* of those left out: further than 5 cm from any surface; within 15 cm of both kinds */
  double left_out_weight;  /* share of the summed weights that those left out have */
  int64_t critical, critical_high; /* Gaussians on critical things; of these, those with a priority over 0.5 */
  int64_t other, other_high;       /* the same of Gaussians on other things */
} pags_priority_truth;

/* Renders the training views once more. All zero where the data set has no truth/street.json, or the scene no
 * priorities. */
pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options, pags_priority_truth *out);

void pags_priority_truth_put_json(pags_json_writer *writer, const pags_priority_truth *priority_truth);

#endif
