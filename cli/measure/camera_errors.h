/* SPDX-License-Identifier: Apache-2.0 */
/* Errors of a scene's camera poses against the true ones that synthetic data sets include. */
#ifndef PAGS_CLI_CAMERA_ERRORS_H
#define PAGS_CLI_CAMERA_ERRORS_H

#include <pags/scene.h>
#include "base/json.h"

/* Root mean squares over views. */
typedef struct pags_camera_error {
  double metres, degrees;
} pags_camera_error;

/* Errors of training and held-out views, as recorded and as corrected by training; each after the rigid motion that
 * brings all recorded (or corrected) training cameras nearest to the truth, since the placement of the world is
 * arbitrary. */
typedef struct pags_camera_errors {
  int64_t views[2]; /* training views, held-out views; 0: the data set has no truth */
  pags_camera_error recorded[2], corrected[2];
} pags_camera_errors;

/* Measures against truth/cameras/C.json of the data set; all zero without such files. */
pags_result pags_camera_errors_measure(const char *dataset, const pags_scene *scene, pags_camera_errors *out);

/* Writes the JSON member `cameras`: an object, or null without truth. */
void pags_camera_errors_put_json(pags_json_writer *writer, const pags_camera_errors *errors);

#endif
