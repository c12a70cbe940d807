/* SPDX-License-Identifier: Apache-2.0 */
/* A cluster's projected members, as the second half of a backward pass or of scores reads them. A frame that draws has
 * their splats. An owner (shared_splats.h), whose splats were sent away, has one byte per Gaussian: whether it was
 * drawn, and which colours were clamped. With a rolling shutter the positions are needed too; the same kernel projects
 * them again.
 */
#ifndef PAGS_FRAME_MEMBERS_H
#define PAGS_FRAME_MEMBERS_H

#include "frame/stages.h"

enum { MOST_MEMBERS = PAGS_LARGEST_CLUSTER };  /* of a cluster */
enum { MEMBER_CLAMPED = 7, MEMBER_DRAWN = 8 }; /* flags: pags_splat.clamped; the splat was taken */

/* A cluster's keys, splats and slots, as pags_kernels.project_backward reads them. */
typedef struct frame_members {
  const uint32_t *keys;
  const pags_splat *splats;
  const int64_t *slot_start;
} frame_members;

/* One worker's memory for them. */
typedef struct member_scratch member_scratch;

/* Allocates the scratch of all workers from the frame's arena; NULL if the frame has its splats. PAGS_ERROR_MEMORY. */
pags_result pags_frame_reserve_members(pags_frame *frame, member_scratch **out);
/* The members of a cluster; valid until the worker's next call. */
frame_members pags_frame_members(const pags_frame *frame, const view_cluster *cluster, member_scratch *scratch,
                                 int worker);

#endif
