/* SPDX-License-Identifier: Apache-2.0 */
/* The adaptive density control of 3D Gaussian splatting (Kerbl et al. 2023): clone, split, prune, reset of
 * opacities. */
#ifndef PAGS_TRAIN_DENSIFY_H
#define PAGS_TRAIN_DENSIFY_H

#include "train/model.h"

typedef enum pags_edit { PAGS_EDIT_KEEP, PAGS_EDIT_CLONE, PAGS_EDIT_SPLIT, PAGS_EDIT_PRUNE } pags_edit;

typedef struct pags_edits {
  uint8_t *kind;                 /* a pags_edit per row; freed by pags_edits_destroy */
  int64_t count;                 /* number of rows (Gaussians) */
  int64_t cloned, split, pruned; /* of all ranks */
  int64_t wanted;                /* number of clones and splits before the limit on Gaussians cut them */
} pags_edits;

/* Decides for each Gaussian of a settled model (no pending Adam steps) what happens to it, from its statistics and
 * parameters; changes nothing. `edits` receives the decisions and must be destroyed on failure, too. */
pags_result pags_densify_decide(const pags_train_model *model, pags_tasks *tasks, pags_edits *edits);
/* Applies the edits to parameters, moments and statistics, sorts the Gaussians, and clears the statistics. */
pags_result pags_densify_apply(pags_train_model *model, const pags_edits *edits, pags_tasks *tasks);
void pags_edits_destroy(pags_edits *edits);

/* Opacity reset: lowers every opacity above reset_opacity to reset_opacity and sets the moments of opacity to zero.
 * The model must be settled (no pending Adam steps). */
void pags_densify_reset(pags_train_model *model);
/* Multiplies all sigmas by density.scale_reset and sets their moments to zero. The model must be settled. */
void pags_densify_reset_scales(pags_train_model *model, pags_tasks *tasks);

#endif
