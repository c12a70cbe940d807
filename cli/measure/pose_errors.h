/* SPDX-License-Identifier: Apache-2.0 */
/* Errors of a scene's object tracks against the true tracks that synthetic data sets include. */
#ifndef PAGS_CLI_POSE_ERRORS_H
#define PAGS_CLI_POSE_ERRORS_H

#include <pags/scene.h>
#include "base/json.h"

/* Mean pose errors over the keyframes of the tracks. */
typedef struct pags_pose_error {
  double label_metres, label_degrees; /* errors of the labelled poses */
  double metres, degrees;             /* errors of the scene's poses, corrected by training */
} pags_pose_error;

/* Errors of objects with a model of their own. In `relative`, each track's mean error in the object's frame is
 * subtracted first: the origin of an object is a convention of the labels that no photograph determines. */
typedef struct pags_pose_errors {
  int64_t objects, keyframes, held_out_keyframes; /* objects 0: the data set has no truth */
  pags_pose_error absolute, relative;             /* errors at trained keyframes */
  pags_pose_error held_out;                       /* errors at the other keyframes, which training never used */
} pags_pose_errors;

/* Measures the errors against truth/instances/instances_info.json of the data set; all zero if there is no such
 * file. */
pags_result pags_pose_errors_measure(const char *dataset, const pags_scene *scene, pags_pose_errors *out);

/* Writes the JSON member `poses`: an object, or null without truth. Its recovered shares are 1 - trained / labelled,
 * null if the labels have no error. */
void pags_pose_errors_put_json(pags_json_writer *writer, const pags_pose_errors *errors);

#endif
