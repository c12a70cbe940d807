/* SPDX-License-Identifier: Apache-2.0 */
/* A round of views: a process alone draws one view, several ranks one each (shared_views.h). The
 * views are those of trainer->round[0 .. count), of which `view` and `camera` are set. */
#ifndef PAGS_TRAIN_ROUND_H
#define PAGS_TRAIN_ROUND_H

#include "train/run.h"

/* Collective: brings the splats of all views to the ranks that draw them; nothing with one process. `step`: as of
 * pags_view_render_draw. */
pags_result pags_round_project(pags_trainer *trainer, int64_t step, int count, const pags_frame_options *options);
/* Whether this rank draws one of `count` views. */
bool pags_round_draws(const pags_trainer *trainer, int count);
/* Draws this rank's view. */
pags_result pags_round_draw(pags_trainer *trainer, int64_t step, const pags_frame_options *options,
                            pags_picture *picture);

#endif
