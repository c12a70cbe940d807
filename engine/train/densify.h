/* SPDX-License-Identifier: Apache-2.0 */
/* 3DGS's adaptive density control: clone, split, prune, reset. */
#ifndef PAGS_TRAIN_DENSIFY_H
#define PAGS_TRAIN_DENSIFY_H

#include "train/model.h"

typedef enum pags_edit { PAGS_EDIT_KEEP, PAGS_EDIT_CLONE, PAGS_EDIT_SPLIT, PAGS_EDIT_PRUNE } pags_edit;

typedef struct pags_edits {
  uint8_t *kind; /* pags_edit per row; freed by pags_edits_destroy */
  int64_t count; /* rows */
  int64_t cloned, split, pruned;
  int64_t wanted; /* clones and splits before the bound on Gaussians cut them */
} pags_edits;

/* Decides from statistics and parameters of a settled model; changes nothing. */
pags_result pags_densify_decide(const pags_train_model *model, pags_edits *edits);
/* Carries the edits out in parameters, moments and statistics, sorts, and clears the statistics. */
pags_result pags_densify_apply(pags_train_model *model, const pags_edits *edits, pags_tasks *tasks);
void pags_edits_destroy(pags_edits *edits);

/* Lowers all opacities to reset_opacity at most and forgets their moments. The model must be settled. */
void pags_densify_reset(pags_train_model *model);

#endif
