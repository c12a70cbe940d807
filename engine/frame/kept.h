/* SPDX-License-Identifier: Apache-2.0 */
/* What the second half of a backward pass, or of scores, needs of a cluster's projected members: of a frame that draws,
 * its own splats; of an owner (splats.h), whose splats are gone, what one byte a Gaussian tells. The backward pass
 * projects by itself; from the splats it takes whether they are drawn, which colours were clamped and, with a rolling
 * shutter, where they are. Only for that they are projected again, by the same kernel. */
#ifndef PAGS_FRAME_KEPT_H
#define PAGS_FRAME_KEPT_H

#include "frame/stages.h"

enum { KEPT_CLAMPED = 7, KEPT_DRAWN = 8 }; /* pags_splat.clamped; the splat has been taken */

/* A cluster's keys, splats and slots, as pags_kernels.project_backward reads them. */
typedef struct frame_members {
  const uint32_t *keys;
  const pags_splat *splats;
  const int64_t *slot_start;
} frame_members;

/* A worker's memory for them. */
typedef struct kept_room kept_room;

/* Of all workers, from the frame's arena; PAGS_ERROR_MEMORY. NULL where the frame has its splats. */
pags_result pags_frame_kept_reserve(pags_frame *frame, kept_room **out);
/* The members of a cluster; they stand until the worker's next call. */
frame_members pags_frame_members(const pags_frame *frame, const view_cluster *cluster, kept_room *room, int worker);

#endif
