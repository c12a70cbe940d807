/* SPDX-License-Identifier: Apache-2.0 */
/* A run that several ranks share: what they begin with, and how rank 0 gets all of it in the end. */
#ifndef PAGS_TRAIN_SHARE_RUN_H
#define PAGS_TRAIN_SHARE_RUN_H

#include "train/run.h"

/* Refuses what several ranks can't do yet. */
pags_result pags_share_run_check(const pags_train_options *options);
/* Collective: begins to share. Every rank has its share of all models alone, as pags_shares_cut cuts it. */
pags_result pags_share_run_begin(pags_trainer *trainer);
/* Collective, when nothing more is drawn: brings the Gaussians to rank 0, which then writes the scene. */
pags_result pags_share_run_end(pags_trainer *trainer);
void pags_share_run_destroy(pags_trainer *trainer); /* a zeroed one is allowed */
/* Collective, after a step: *stop if one of the ranks wants to stop, *save if rank 0 wants a checkpoint; fails if one
 * has failed, `mine` being how this rank has fared. */
pags_result pags_share_run_agree(const pags_trainer *trainer, pags_result mine, int *stop, bool *save);

#endif
