/* SPDX-License-Identifier: Apache-2.0 */
/* The density control of 3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al. 2024): relocation,
 * growth, regularisers and noise. It replaces clone, split, prune and reset under strategy mcmc. */
#ifndef PAGS_TRAIN_MCMC_H
#define PAGS_TRAIN_MCMC_H

#include "train/model.h"

/* Call at every densify step, on a settled model (no pending Adam steps). Moves dead Gaussians onto live ones drawn
 * in proportion to opacity, then adds 5 % of the count, up to the limit on Gaussians. Opacity and sigma of
 * the Gaussians that share a place are changed so that the picture hardly changes. Sorts the Gaussians. */
pags_result pags_mcmc_refine(pags_train_model *model, pags_tasks *tasks);

/* Adds the gradient of the two regularisers (mean opacity, mean sigma) to the gradients of `rows` Gaussians from row
 * `first` on; plane p of `gradient` is at gradient + p * stride, planes 0 .. PAGS_OPACITY are used. */
void pags_mcmc_regularise(const pags_train_model *model, int64_t first, int rows, float *gradient, int64_t stride);

/* Call at every step, after the updates: adds noise to the positions of Gaussians near transparency and recomputes
 * the bounds of the clusters. All rows must be current as of the step. */
pags_result pags_mcmc_noise(pags_train_model *model, int64_t step, pags_tasks *tasks);

/* Computes the opacity and the factor on sigma of each of `copies` Gaussians that together shall replace one of
 * opacity `opacity` (equation 9 of Kheradmand et al. 2024). */
void pags_mcmc_relocation(double opacity, int copies, double *new_opacity, double *factor);

#endif
