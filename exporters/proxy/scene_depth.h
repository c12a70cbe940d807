/* SPDX-License-Identifier: Apache-2.0 */
/* How far the training cameras see into the whole scene, objects where they are at each view's time: what lies behind
 * that is hidden, whatever it would look like drawn alone. */
#ifndef PAGS_PROXY_SCENE_DEPTH_H
#define PAGS_PROXY_SCENE_DEPTH_H

#include <pags/scene.h>

#include "exporters/proxy/depth_view.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_scene_depth_view {
  pags_camera camera; /* pose in the scene's frame, relative to its origin */
  uint16_t *depth;    /* camera z in metres as binary16: 0 unknown, infinite where nothing is */
} pags_scene_depth_view;

typedef struct pags_scene_depth {
  int64_t count;
  pags_scene_depth_view *views; /* one a view of the scene; depth NULL: held out, or not drawn */
} pags_scene_depth;

/* Draws every training view, no wider than `widest` pixels. `low_pass` as trained. */
pags_result pags_scene_depth_draw(const pags_scene *scene, pags_frame *frame, const pags_frame_options *drawing,
                                  int widest, pags_scene_depth *out);
void pags_scene_depth_destroy(pags_scene_depth *scene_depth); /* frees and zeroes */

/* The drawing of a view by a camera of another size: the low-pass, a pixel's when trained, shrinks with the picture. */
pags_frame_options pags_drawing_at(const pags_frame_options *drawing, const pags_camera *trained,
                                   const pags_camera *drawn);

/* Takes back what `depth view`, drawn of a part of the scene by the same view, says of what the rest hides: there its
 * rays are free as far as the whole scene lets them through, and nothing is known beyond. */
void pags_depth_view_hide(pags_depth_view *depth_view, const pags_scene_depth_view *view);

#ifdef __cplusplus
}
#endif
#endif
