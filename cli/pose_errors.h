/* SPDX-License-Identifier: Apache-2.0 */
/* Where a scene's tracks lie beside the truth that synthetic data sets bring. */
#ifndef PAGS_CLI_POSE_ERRORS_H
#define PAGS_CLI_POSE_ERRORS_H

#include <pags/scene.h>
#include "base/json.h"

/* Means over knots. */
typedef struct pags_pose_error {
  double label_metres, label_degrees; /* of the poses as labelled */
  double metres, degrees;             /* of the poses as the scene has them */
} pags_pose_error;

/* Of moving objects. `relative` is after each track's mean error, in the object's frame, has been taken away: where in
 * its box a thing stands is a matter of convention, which no photograph decides. */
typedef struct pags_pose_errors {
  int64_t objects, knots, held_out_knots; /* objects 0: there is no truth */
  pags_pose_error absolute, relative;     /* trained knots */
  pags_pose_error held_out;               /* the others, whose time training never saw */
} pags_pose_errors;

/* Reads truth/instances/instances_info.json of the data set; all zero where there is none. */
pags_result pags_pose_errors_measure(const char *dataset, const pags_scene *scene, pags_pose_errors *out);

/* An object `poses`, or null; shares recovered are 1 - trained / labelled, null where the labels have no error. */
void pags_pose_errors_put_json(pags_json_writer *writer, const pags_pose_errors *errors);

#endif
