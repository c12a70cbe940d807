/* SPDX-License-Identifier: Apache-2.0 */
/* A frame whose Gaussians are distributed over owners (ranks). Each owner culls, projects and shades its Gaussians and
 * sends the splats that touch a tile. One frame draws the splats of all owners and returns, per splat, the sums of its
 * backward pass or scores. The owners then compute the gradients of their parameters. Picture and gradients have the
 * bits of one frame of all Gaussians: splats are drawn by (depth, id) whatever the order in which they arrive, and a
 * splat's sums are taken over its tiles in the order of one frame.
 *
 * Owners call, in this order, pags_frame_project, pags_frame_take_splats and, any number of times,
 * pags_frame_return_sums and pags_frame_return_scores. In between they keep one byte per Gaussian
 * (frame/members.h); the parameters must stay as they were projected. The frame that draws calls
 * pags_frame_draw_splats, then pags_frame_splat_sums and pags_frame_splat_scores. The options need keep_for_backward,
 * and the same for all. */
#ifndef PAGS_FRAME_SHARED_SPLATS_H
#define PAGS_FRAME_SHARED_SPLATS_H

#include <pags/frame.h>

/* A projected Gaussian as sent: 56 bytes. pags_splat (simd/kernels.h) has the meaning of the members. */
typedef struct pags_sent_splat {
  float x, y, p, h, w, log2_opacity, r, g, b, z, slope;
  int32_t id;
  float extent[2]; /* half the size of the box outside of which it isn't blended, px */
} pags_sent_splat;

enum { PAGS_SPLAT_SUMS = 12 };
/* Gradients of a splat, summed over its pixels, as returned: 48 bytes. */
typedef struct pags_splat_sums {
  float sum[PAGS_SPLAT_SUMS];
} pags_splat_sums;

/* Scores of a splat: the members of pags_cluster_score for one Gaussian. */
typedef struct pags_splat_scores {
  double seen, critical, squared;
} pags_splat_scores;

/* ---- Owners ---- */

/* Culls, touches, projects and shades the parts; *count receives how many of their Gaussians touch a tile. Until they
 * are taken, the splats lie in the memory of `lender`, another frame, which loses its picture and must not be used
 * meanwhile. Errors as pags_frame_render. */
pags_result pags_frame_project(pags_frame *frame, pags_frame *lender, const pags_part *parts, int part_count,
                               const pags_camera *camera, const pags_frame_options *options, pags_touch_fn *touch,
                               void *user, int64_t *count);
/* Writes these splats, part after part and row after row, and forgets them. PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_frame_take_splats(pags_frame *frame, pags_sent_splat *out);
/* Goes back through shading and projection, as pags_frame_backward does, from the sums of the splats taken, one for
 * each in their order. Only parts from `first_part` on; the sums of others aren't read. */
pags_result pags_frame_return_sums(pags_frame *frame, int first_part, const pags_splat_sums *sums,
                                   pags_receive_fn *receive, void *user, int64_t *bad_rows);
/* As pags_frame_scores, from the scores of all splats taken. */
pags_result pags_frame_return_scores(pags_frame *frame, const pags_splat_scores *scores, pags_score_fn *receive,
                                     void *user);
/* Number of the splats taken from parts before `part`. */
int64_t pags_frame_splats_before(const pags_frame *frame, int part);

/* ---- The frame that draws ---- */

/* Draws splats of Gaussians that all have the same alpha_min (pags/gaussians.h), with distinct ids. */
pags_result pags_frame_draw_splats(pags_frame *frame, const pags_sent_splat *splats, int64_t count, float alpha_min,
                                   const pags_camera *camera, const pags_frame_options *options, pags_picture *out);
/* The first half of pags_frame_backward: the sums of each splat, in the order in which the splats came. Also hands over
 * the sky's gradient. */
pags_result pags_frame_splat_sums(pags_frame *frame, const pags_picture_gradient *gradient, pags_splat_sums *out);
/* The first half of pags_frame_scores, in the same order. */
pags_result pags_frame_splat_scores(pags_frame *frame, const pags_score_planes *planes, pags_splat_scores *out);

#endif
