/* SPDX-License-Identifier: Apache-2.0 */
/* A depth view: some Gaussians (an object's, the background's) drawn by one training camera, with depth, alpha and
 * colour of each pixel, in the frame of these Gaussians. */
#ifndef PAGS_PROXY_DEPTH_VIEW_H
#define PAGS_PROXY_DEPTH_VIEW_H

#include <stdbool.h>

#include <pags/frame.h>
#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Depth codes of pixels without a surface. */
#define PAGS_DEPTH_VIEW_UNKNOWN 0.0f /* the pixel is half covered or at a depth discontinuity: says nothing */
#define PAGS_DEPTH_VIEW_FREE \
  (-1e30f) /* the ray meets nothing. Any other negative depth -d: the ray is free up to d and unknown beyond */

enum {
  PAGS_DEPTH_VIEW_CELL = 8,
  PAGS_DEPTH_VIEW_WIDEST = 480
}; /* pixels: side of a cell of depth bounds; most width of a view of the background */

typedef struct pags_depth_view {
  double blur;        /* standard deviation of the low-pass filter by which drawing widens Gaussians, pixels */
  double nearest;     /* camera z up to which it says nothing, metres */
  pags_camera camera; /* the camera of the cropped picture, in the model's frame */
  double camera_from_model[12];
  int64_t view;    /* index of the view in the scene */
  float *depth;    /* camera z in metres, or a code above */
  float *plane;    /* camera z where the ray meets the plane of the Gaussian that contributes most to the pixel, if it
                      is flat; 0: it isn't. NULL: not asked for */
  uint8_t *cover;  /* alpha, 0..255 */
  uint8_t *labels; /* Cityscapes' train id of each pixel, set by the caller; NULL: none */
  uint8_t *rgb;    /* 3 a pixel, display-referred sRGB of the Gaussians without the background */
  int cells_x, cells_y; /* cells of PAGS_DEPTH_VIEW_CELL pixels a side */
  float *lo, *hi;       /* least and greatest depth of each cell; of free pixels the free length, of unknown ones 0 */
} pags_depth_view;

typedef struct pags_depth_views {
  int64_t count, capacity;
  pags_depth_view *list;
} pags_depth_views;

void pags_depth_views_destroy(pags_depth_views *depth_views); /* frees and zeroes */

/* Draws `parts` by `camera`, both in the model's frame, and appends the result as a depth view. With `planes`, its
 * member `plane` is filled in; there must then be one part only. */
pags_result pags_depth_views_add(pags_depth_views *depth_views, pags_frame *frame, const pags_part *parts,
                                 int part_count, const pags_camera *camera, const pags_frame_options *options,
                                 int64_t view, bool planes);

/* Takes the depth of each pixel's plane for its depth, where there is one near it: 20 % or less off. */
void pags_depth_view_flatten(pags_depth_view *depth_view);

/* Updates `lo` and `hi` after a change of depths. */
void pags_depth_view_bound(pags_depth_view *depth_view);

/* In a depth view of a vehicle drawn alone, in the frame of its box, marks pixels that show its shadow or the ground
 * next to it: their rays become free up to that depth. `size` is the box's, in metres. PAGS_ERROR_MEMORY. */
pags_result pags_depth_view_filter_shadow(pags_depth_view *depth_view, const double size[3]);

/* Crops the camera's picture to the rectangle where the box `lo`..`hi` may be seen; returns false if it is nowhere. */
bool pags_camera_crop(const pags_camera *camera, const double lo[3], const double hi[3], double near_plane,
                      pags_camera *out);

/* Whether any point of a ball may be in the picture at a camera z of at most `range`. */
bool pags_depth_view_may_see(const pags_depth_view *depth_view, const double middle[3], double radius, double range);

typedef enum pags_depth_view_verdict {
  PAGS_DEPTH_VIEW_MIXED, /* undecided: its points must be looked at one by one */
  PAGS_DEPTH_VIEW_CLEAR, /* the whole ball lies in front of all depths there by at least the margin */
  PAGS_DEPTH_VIEW_HIDDEN /* the whole ball lies behind all depths there by more than the margin, or all are unknown */
} pags_depth_view_verdict;
/* Compares a ball with the depths of the pixels that it projects to, by the bounds of the cells. `z` receives the
 * camera z of the ball's middle. */
pags_depth_view_verdict pags_depth_view_classify(const pags_depth_view *depth_view, const double middle[3],
                                                 double radius, double margin, double *z);

/* Projects a point in the model's frame to its pixel and camera z. Returns false if it is not in the picture. */
bool pags_depth_view_project(const pags_depth_view *depth_view, const double point[3], int *x, int *y, double *z);
/* The point, in the model's frame, on the ray through a pixel's centre at camera z. */
void pags_depth_view_point(const pags_depth_view *depth_view, int x, int y, double z, double point[3]);

/* Sets `n` to the cross product of the differences of a pixel's point `p` to the points at the depths of the pixels at
 * (side, y) and (x, next). Returns false if one of the two has no depth. */
bool pags_depth_view_normal(const pags_depth_view *depth_view, int x, int y, int side, int next, const double p[3],
                            double n[3]);

/* pags_parallel_for and a call of a pags_progress_fn (NULL: none) that fail with PAGS_CANCELLED. For loops whose items
 * can fail see base/parallel.h. */
pags_result pags_proxy_for(pags_tasks *tasks, int64_t count, int64_t grain, pags_block_fn *fn, void *context);
pags_result pags_proxy_tell(pags_progress_fn *tell, void *user, double fraction, const char *what);

#ifdef __cplusplus
}
#endif
#endif
