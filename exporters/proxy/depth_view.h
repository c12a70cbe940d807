/* SPDX-License-Identifier: Apache-2.0 */
/* What a training camera sees of some Gaussians: depth, cover and colour of its pixels, in the frame of a model. */
#ifndef PAGS_PROXY_DEPTH_VIEW_H
#define PAGS_PROXY_DEPTH_VIEW_H

#include <pags/frame.h>
#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Depth codes of pixels without a surface. */
#define PAGS_DEPTH_VIEW_UNKNOWN 0.0f /* half covered, or at an edge of depth: says nothing */
#define PAGS_DEPTH_VIEW_FREE \
  (-1e30f) /* nothing there: the ray is free all along. Any negative depth: free as far as that, unknown beyond */

enum {
  PAGS_DEPTH_VIEW_CELL = 8,
  PAGS_DEPTH_VIEW_WIDEST = 480
}; /* pixels: of a cell's side, of a view of the background */

typedef struct pags_depth_view {
  double blur;        /* pixels by which drawing widens each Gaussian: the low-pass's sigma */
  pags_camera camera; /* of the part of the picture; its world is the model's frame */
  double camera_from_model[12];
  int64_t view; /* of the scene */
  float *depth; /* camera z in metres, or as above */
  float *plane; /* camera z where the ray meets the plane of the flat Gaussian that most of the pixel is of; 0: of none.
                   NULL: not asked for */
  uint8_t *cover;       /* alpha, 0..255 */
  uint8_t *labels;      /* what its users make of them, one a pixel; NULL: none */
  uint8_t *rgb;         /* 3 a pixel, display-referred sRGB without what is behind the Gaussians */
  int cells_x, cells_y; /* of PAGS_DEPTH_VIEW_CELL pixels a side */
  float *lo, *hi;       /* of a cell's depths: free pixels count as far as they are, unknown ones as 0 */
} pags_depth_view;

typedef struct pags_depth_views {
  int64_t count, capacity;
  pags_depth_view *list;
} pags_depth_views;

void pags_depth_views_destroy(pags_depth_views *depth_views); /* frees and zeroes */

/* Draws `parts` (whose world is the model's frame) by `camera` (in the model's frame) and adds what is seen; `planes`
 * of the only part. */
pags_result pags_depth_views_add(pags_depth_views *depth_views, pags_frame *frame, const pags_part *parts,
                                 int part_count, const pags_camera *camera, const pags_frame_options *options,
                                 int64_t view, int planes);

/* Brings `lo` and `hi` up to date after a change of depths. */
void pags_depth_view_bound(pags_depth_view *depth_view);

/* Cuts the camera down to where the box `lo`..`hi` of its world may be seen; 0: nowhere. */
int pags_camera_crop(const pags_camera *camera, const double lo[3], const double hi[3], double near_plane,
                     pags_camera *out);

/* Whether any point of a ball may be in the picture, no farther than `range`. */
int pags_depth_view_may_see(const pags_depth_view *depth_view, const double middle[3], double radius, double range);

typedef enum pags_depth_view_verdict {
  PAGS_DEPTH_VIEW_MIXED, /* look at its points */
  PAGS_DEPTH_VIEW_CLEAR, /* all of it lies before everything seen by at least the margin */
  PAGS_DEPTH_VIEW_HIDDEN /* all of it lies behind it by more than that, or where nothing is known */
} pags_depth_view_verdict;
/* Of a ball that may be seen: how it lies to what is seen where it is in the picture. `z` receives its middle's. */
pags_depth_view_verdict pags_depth_view_classify(const pags_depth_view *depth_view, const double middle[3],
                                                 double radius, double margin, double *z);

/* Pixel and camera z of a point of the model; 0 when it is not in the picture. */
int pags_depth_view_project(const pags_depth_view *depth_view, const double point[3], int *x, int *y, double *z);
/* The point of the model at a pixel's centre and camera z. */
void pags_depth_view_point(const pags_depth_view *depth_view, int x, int y, double z, double point[3]);

#ifdef __cplusplus
}
#endif
#endif
