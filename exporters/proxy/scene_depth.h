/* SPDX-License-Identifier: Apache-2.0 */
/* The depth of the whole scene in each training view, with every object at its pose at the view's time. Depth views
 * of a part of the scene use it to tell which of their pixels the rest of the scene hides. */
#ifndef PAGS_PROXY_SCENE_DEPTH_H
#define PAGS_PROXY_SCENE_DEPTH_H

#include <pags/scene.h>
#include <stdbool.h>

#include "exporters/proxy/depth_view.h"

typedef struct pags_scene_depth_view {
  pags_camera camera; /* pose in the scene's frame, relative to its origin */
  uint16_t *depth;    /* camera z in metres as binary16: 0: unknown; infinite: the ray meets nothing */
} pags_scene_depth_view;

typedef struct pags_scene_depth {
  int64_t count;
  pags_scene_depth_view *views; /* one for each view of the scene; depth NULL: the view is held out or wasn't drawn */
} pags_scene_depth;

/* Draws the depth of every training view, scaled down to at most `widest` pixels of width. `drawing` has the low-pass
 * filter that the scene was trained with. Without `draw` only the cameras are set. After a failure, too, the caller
 * destroys `out`. */
pags_result pags_scene_depth_draw(const pags_scene *scene, pags_frame *frame, const pags_frame_options *drawing,
                                  int widest, bool draw, pags_scene_depth *out);
void pags_scene_depth_destroy(pags_scene_depth *scene_depth); /* frees and zeroes */

/* The options for drawing a view scaled down. The low-pass variance is in squared pixels of the training picture, so
 * it shrinks with the square of the scale. */
pags_frame_options pags_drawing_at(const pags_frame_options *drawing, const pags_camera *trained,
                                   const pags_camera *drawn);

/* Corrects a depth view that was drawn of a part of the scene from the same view: at pixels where the rest of the
 * scene hides that part, and along rays that meet nothing of it, the depth becomes "free up to the whole scene's
 * depth, unknown beyond" (a negative depth). */
void pags_depth_view_hide(pags_depth_view *depth_view, const pags_scene_depth_view *view);

#endif
