/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the Gaussians' priorities with the truth of a synthetic street: Gaussians on critical objects should have
 * a high priority, and only those. */
#ifndef PAGS_CLI_PRIORITY_TRUTH_H
#define PAGS_CLI_PRIORITY_TRUTH_H

#include "cli/common/photographs.h"

#include <pags/compose.h>
#include "base/json.h"

/* A Gaussian's owner is the true surface nearest to its mean at the time of the training view in which the Gaussian
 * has its largest weight. A Gaussian is seen if its weights alpha T over all training views sum up to at least one
 * pixel. A seen Gaussian is counted if its mean lies within 5 cm of its owner and more than 15 cm from any surface of
 * the other kind; the kinds are critical and other. */
typedef struct pags_priority_truth {
  int64_t seen, counted; /* seen 0: no truth */
  /* of the seen ones not counted: further than 5 cm from any surface; within 15 cm of both kinds */
  int64_t astray, between;
  double left_out_weight; /* the left-out Gaussians' share of the summed weights of all seen ones */
  /* counted Gaussians on critical surfaces; those of them with a priority over 0.5 */
  int64_t critical, critical_high;
  int64_t other, other_high; /* the same for counted Gaussians on other surfaces */
} pags_priority_truth;

/* Renders the training views once more and compares the priorities. `out` is all zero if the data set has no
 * truth/street.json or the scene has no priorities. */
pags_result pags_priority_truth_measure(pags_composition *composition, const pags_photographs *photographs,
                                        pags_frame *frame, const pags_frame_options *options, pags_priority_truth *out);

void pags_priority_truth_put_json(pags_json_writer *writer, const pags_priority_truth *priority_truth);

#endif
