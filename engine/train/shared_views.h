/* SPDX-License-Identifier: Apache-2.0 */
/* Drawing by several ranks (cluster/transport.h). Each rank owns a share of the Gaussians; the views of a round, at
 * most one a rank, are drawn one by each: rank r draws view r. The owners project their Gaussians for every view and
 * send the splats to the rank that draws it, which sends back the sums of each splat (frame/shared_splats.h). */
#ifndef PAGS_TRAIN_SHARED_VIEWS_H
#define PAGS_TRAIN_SHARED_VIEWS_H

#include <pags/frame.h>
#include <pags/train.h>

#include "cluster/transport.h"
#include "frame/shared_splats.h"

/* Memory that is kept from round to round and grows. */
typedef struct pags_buffer {
  void *data;
  int64_t room; /* bytes */
} pags_buffer;

typedef struct pags_shared_views {
  pags_transport *transport;
  int rank, ranks;
  int count;           /* views of the round */
  pags_frame **owners; /* [ranks]: frames that project the own Gaussians, one for each view of the round */
  /* [ranks] splats sent for each view, and arrived of the own view from each rank; and how many of them, which come
   * first, are of the background. */
  int64_t *sent, *sent_before, *arrived, *arrived_before;
  /* Splats of all views on their way there, then what comes back of them, view after view, which takes less room. */
  pags_buffer sending;
  /* Splats of the own view, then what goes back of them; the same of the moving objects alone. */
  pags_buffer splats, object_splats;
  pags_buffer object_sums, spread; /* sums of objects that come back; those of one view in their places */
  int64_t bytes_there, bytes_back; /* of the round: splats received, and sums sent, as the transport counts them */
} pags_shared_views;

pags_result pags_shared_views_create(pags_shared_views *shared, pags_transport *transport, pags_tasks *tasks);
void pags_shared_views_destroy(pags_shared_views *shared); /* a zeroed struct is allowed */

/* ---- A round: begin; project for each view; send; on ranks that have a view, draw and sums; then the returns ---- */

void pags_shared_views_begin(pags_shared_views *shared, int count);
/* Projects the own Gaussians for view number `view` of the round, one view after the other; part 0 is the background.
 * `lender`: a frame whose memory is used meanwhile (frame/shared_splats.h). */
pags_result pags_shared_views_project(pags_shared_views *shared, int view, pags_frame *lender, const pags_part *parts,
                                      int part_count, const pags_camera *camera, const pags_frame_options *options,
                                      pags_touch_fn *touch, void *user);
/* Collective: sends all splats to the ranks that draw them. `mine`: the result of this rank; all ranks fail if
 * one has. */
pags_result pags_shared_views_send(pags_shared_views *shared, pags_result mine);

/* Draws the own view, or, with `objects`, only what isn't of the background. */
pags_result pags_shared_views_draw(pags_shared_views *shared, pags_frame *frame, bool objects, float alpha_min,
                                   const pags_camera *camera, const pags_frame_options *options, pags_picture *out);
/* Sums the gradients of the drawn splats. */
pags_result pags_shared_views_sums(pags_shared_views *shared, pags_frame *frame, bool objects,
                                   const pags_picture_gradient *gradient);
pags_result pags_shared_views_scores(pags_shared_views *shared, pags_frame *frame, const pags_score_planes *planes);

/* Collective: sends sums back to the owners. `objects`: those of the moving objects, of the views for which `drawn` is
 * 1; NULL: all. */
pags_result pags_shared_views_return_sums(pags_shared_views *shared, bool objects, const uint8_t *drawn);
pags_result pags_shared_views_return_scores(pags_shared_views *shared);
/* Goes back from the sums of a view to its own Gaussians, as pags_frame_backward and pags_frame_scores do. */
pags_result pags_shared_views_backward(pags_shared_views *shared, int view, bool objects, const uint8_t *drawn,
                                       pags_receive_fn *receive, void *user);
pags_result pags_shared_views_receive_scores(pags_shared_views *shared, int view, pags_score_fn *receive, void *user);

/* Adds the round to the sums of a run. */
void pags_shared_views_count(const pags_shared_views *shared, pags_train_traffic *sum);

#endif
