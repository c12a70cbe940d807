/* SPDX-License-Identifier: Apache-2.0 */
/* The passes of a sequence of pictures (pags/passes.h) for the channels of a picture writer. */
#ifndef PAGS_CLI_RENDER_PASSES_H
#define PAGS_CLI_RENDER_PASSES_H

#include "cli/draw/picture.h"

typedef struct pags_render_passes {
  pags_composition *composition;
  const pags_picture_writer *writer; /* its channels select the passes; both must outlive this */
  pags_moment moments[2];            /* before, after; their parts are `copies` */
  pags_part *copies[2];
  bool known[2];
  int32_t *names[2]; /* per part: its name in the mattes of objects and classes */
  int capacity[3];   /* parts that the copies and the names have room for */
} pags_render_passes;

/* Composes the scene at the time of the neighbouring camera (side 0: before, 1: after), for motion; NULL: no motion on
 * that side. It uses the composition's parts, so compose the picture itself afterwards. */
pags_result pags_render_passes_moment(pags_render_passes *passes, int side, const pags_camera *camera);
/* Computes the passes of the picture that `frame` has drawn of these parts, as composed by pags_compose. */
pags_result pags_render_passes_draw(pags_render_passes *passes, pags_frame *frame, const pags_part *parts,
                                    int part_count, pags_passes *out);
/* Frees the memory. A zeroed struct is allowed. */
void pags_render_passes_destroy(pags_render_passes *passes);

#endif
