/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing through a lens (pags/lens.h). The kernels project means and covariances (simd/lens.h) to splats of the form
 * that they have for a pinhole, so all later stages are the same. Depth, key and near plane are distances from the
 * camera. Internal to engine/frame. */
#ifndef PAGS_FRAME_LENS_VIEW_H
#define PAGS_FRAME_LENS_VIEW_H

#include <math.h>

#include "frame/members.h"

enum { LENS_STEPS = 128 };

/* A frame's lens, as the stages use it. */
struct frame_lens {
  pags_camera camera; /* checked */
  double farthest;    /* angle from the axis, radians, up to which means are drawn: a little beyond the field of view */
  bool sphere;        /* equirectangular: every direction is seen; the picture repeats after table.turn px */
  pags_lens_table table; /* for the kernels. Lenses of r (pags/lens.h) clamp, as a pinhole does */
  /* reach[i]: no derivative of the pixel by the direction, px a radian, is larger within i / LENS_STEPS of `farthest`
   */
  float reach[LENS_STEPS + 1];
  const float *rays; /* frame->lens_rays: per pixel, planes of the world's x, y, z of its direction; 0, 0, 0: nothing */
};

/* Sets frame->lens, NULL of a pinhole, and the directions of the pixels. */
pags_result pags_frame_prepare_lens(pags_frame *frame);

/* As pags_lens_see, in px of the picture; `jacobian` may be NULL. */
void pags_frame_lens_see(const struct frame_lens *lens, const double point[3], double pixel[2], double jacobian[6]);

/* Sets [*first, *end) to the 4-pixel blocks of an axis of `size` px that have a pixel centre within `aside` of
 * `middle`. */
static inline void lens_blocks(double middle, double aside, double size, uint16_t *first, uint16_t *end) {
  const double blocks = ceil(size * 0.25);
  *first = (uint16_t)fmin(fmax(floor((middle - aside + 0.5) * 0.25), 0), blocks);
  *end = (uint16_t)fmin(fmax(floor((middle + aside - 0.5) * 0.25) + 1, 0), blocks);
}

/* Whether no member of a cluster is drawn whose means lie in the box [lo, hi] of camera space while the picture is
 * read, with at most the speed `speed` along its axes per read-out (used with a rolling shutter), whose sigmas there
 * are at most `sigma`, and which ends at `reach_max` squared sigmas; if any may be, *bound receives its nearest depth,
 * its pixels, and whether it may reach over the seam. */
bool pags_frame_lens_misses(const struct frame_lens *lens, const pags_projection *view, const float lo[3],
                            const float hi[3], const float speed[3], float sigma, float reach_max,
                            cluster_bound *bound);

/* Ends a tile: pixels outside of the lens's field of view get no colour, depth or id, and a transmittance of 1. */
void pags_frame_mask_lens(const pags_frame *frame, int64_t tile);
/* As pags_kernels.sky_find and sky_cells, with the lens's directions, as the camera stands when each line is read. */
void pags_frame_lens_sky(const pags_frame *frame, int x0, int y0, pags_sky_tile *tile);
void pags_frame_lens_cells(const pags_frame *frame, int x0, int y0, int step, int32_t *row, int32_t *column,
                           float *const weight[4]);

#endif
