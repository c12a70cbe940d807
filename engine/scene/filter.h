/* SPDX-License-Identifier: Apache-2.0 */
/* Removes Gaussians from a scene: outside a box or a ball, too faint, too large or small, seen by too few training
 * views; or by the rules of docs/cleanup.md, which also change colours and opacities. */
#ifndef PAGS_SCENE_FILTER_H
#define PAGS_SCENE_FILTER_H

#include <stdbool.h>

#include <pags/scene.h>

/* Positions are in metres relative to the scene's origin, as in the files that are exported. */
typedef struct pags_filter {
  bool has_box, has_ball;
  double lo[3], hi[3];              /* of the box */
  double middle[3], radius;         /* of the ball */
  double least_opacity;             /* 0..1; 0: none is too faint */
  double least_size, greatest_size; /* metres: of the largest sigma; 0: no limit */
  int least_views;                  /* training views in whose picture the mean is; 0: no limit */
} pags_filter;

bool pags_filter_is_set(const pags_filter *filter);

/* Removes the Gaussians that don't pass. An object with its own model is inside the box and the ball as a whole if the
 * middle of its labelled box is, at `time` (seconds; or at its first label if it is absent then); views are not counted
 * for it. `chosen` (NULL, or a byte per object) becomes 0 for objects that are removed as a whole. `left` receives the
 * number of remaining Gaussians. PAGS_ERROR_ARGUMENT if no Gaussian passes, or if `least_views` is set and the scene
 * has no views; PAGS_ERROR_MEMORY. */
pags_result pags_scene_filter(pags_scene *scene, const pags_filter *filter, double time, uint8_t *chosen,
                              int64_t *left);

/* Whether opacity and size of row i pass. */
bool pags_filter_fits(const pags_filter *filter, const pags_gaussians *g, int64_t i);

/* The cameras of the training views, relative to the scene's origin: the inverse of each pose. Its arrays point into
 * the scene. */
typedef struct pags_support {
  int64_t count;
  const pags_camera **cameras;
  double (*camera_from_scene)[12];
} pags_support;

/* Fails if `least` isn't 0 and the scene has no views to count. */
pags_result pags_support_check(const pags_support *support, int least);

pags_result pags_support_find(const pags_scene *scene, pags_support *out);
void pags_support_destroy(pags_support *support); /* a zeroed struct is allowed */

/* Whether a point, relative to the scene's origin, lies in the pictures of at least `least` training views. */
bool pags_support_has(const pags_support *support, int least, const double mean[3]);

/* Applies rules to a scene, one after another. `text` is JSON, an array of objects, and `name` its name in messages;
 * docs/cleanup.md lists the members. PAGS_ERROR_FORMAT for an invalid rule, PAGS_ERROR_ARGUMENT if no Gaussian is left
 * or if the scene has no views to count, PAGS_ERROR_MEMORY. After an error some rules may have been applied: destroy
 * the scene. */
pags_result pags_scene_cleanup(pags_scene *scene, const char *name, const char *text);

#endif
