/* SPDX-License-Identifier: Apache-2.0 */
/* The second density policy: 3D Gaussian splatting as Markov chain Monte Carlo (Kheradmand et al. 2024). */
#ifndef PAGS_TRAIN_MCMC_H
#define PAGS_TRAIN_MCMC_H

#include "train/model.h"

/* Every densify step, on a settled model: dead Gaussians move onto live ones drawn by opacity, then the count grows
 * by mcmc_growth up to the bound; opacity and sigma of what shares a place change so that the picture hardly does.
 * Sorts. */
pags_result pags_mcmc_refine(pags_train_model *model, pags_tasks *tasks);

/* Gradient of the two regularisers added to a cluster's: `gradient` has planes 0 .. PAGS_OPACITY at gradient + p *
 * stride. */
void pags_mcmc_regularise(const pags_train_model *model, int64_t first, int rows, float *gradient, int64_t stride);

/* Every step, after the updates: shakes the positions of Gaussians near transparency, and bounds the clusters anew.
 * All rows must be current as of the step. */
pags_result pags_mcmc_noise(pags_train_model *model, int64_t step, pags_tasks *tasks);

/* The new opacity and the factor on sigma of a Gaussian that `copies` of it shall stand for (their equation 9). */
void pags_mcmc_relocation(double opacity, int copies, double *new_opacity, double *factor);

#endif
