/* SPDX-License-Identifier: Apache-2.0 */
/* Removes Gaussians from a scene: outside a box or a ball, too faint, too large or small, seen by too few training
 * views; or by the rules of docs/cleanup.md, which also change colours and opacities. */
#ifndef PAGS_SCENE_FILTER_H
#define PAGS_SCENE_FILTER_H

#include <stdbool.h>

#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

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

/* Removes the Gaussians that don't pass. Objects with a model of their own are judged by where they are at `time`
 * (seconds; when they aren't there then, at their first label): they are in the box and the ball as a whole if the
 * middle of their labelled box is, and views aren't counted for them. `chosen` (NULL, or a byte an object) becomes 0
 * for objects that are left out as a whole. `left` receives how many Gaussians there are now. PAGS_ERROR_ARGUMENT if
 * none passes, or if views are asked for and there are none; PAGS_ERROR_MEMORY. */
pags_result pags_scene_filter(pags_scene *scene, const pags_filter *filter, double time, uint8_t *chosen,
                              int64_t *left);

/* Whether opacity and size of row i pass. */
bool pags_filter_fits(const pags_filter *filter, const pags_gaussians *g, int64_t i);

/* Keeps the rows listed in `index`, in this order. PAGS_ERROR_MEMORY. */
pags_result pags_filter_keep(pags_gaussians *g, const int64_t *index, int64_t count);

/* The cameras of the training views, relative to the scene's origin: the inverse of each pose. Its arrays point into
 * the scene. */
typedef struct pags_support {
  int64_t count;
  const pags_camera **cameras;
  double (*camera_from_scene)[12];
} pags_support;

pags_result pags_support_find(const pags_scene *scene, pags_support *out);
void pags_support_destroy(pags_support *support); /* a zeroed struct is allowed */

/* Whether a point, relative to the scene's origin, falls into the pictures of at least so many training views. */
bool pags_support_has(const pags_support *support, int least, const double mean[3]);

/* Applies rules to a scene, one after another. `text` is JSON, an array of objects; `name` stands for it in messages.
 * docs/cleanup.md lists their members. PAGS_ERROR_FORMAT for what isn't a rule, PAGS_ERROR_ARGUMENT where no Gaussian
 * is left or where the scene has no views to count, PAGS_ERROR_MEMORY; then some rules may have been applied, and the
 * scene is only to be destroyed. */
pags_result pags_scene_cleanup(pags_scene *scene, const char *name, const char *text);

#ifdef __cplusplus
}
#endif
#endif
