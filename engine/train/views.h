/* SPDX-License-Identifier: Apache-2.0 */
/* Lists the training views, chooses their order and the size at which they are seen, and provides their
 * photographs. */
#ifndef PAGS_TRAIN_VIEWS_H
#define PAGS_TRAIN_VIEWS_H

#include "train/run.h"

/* Number of views ahead of their use whose photographs the cache decodes. */
enum { PAGS_TRAIN_AHEAD = 32 };

/* Lists the training views and computes the fingerprint by which a checkpoint is recognised as belonging to them. */
pags_result pags_views_list(pags_trainer *trainer);

/* Returns the mean number of pixels of the training photographs at their full size. */
double pags_views_mean_pixels(const pags_trainer *trainer);

/* Size of the largest training photograph. */
void pags_views_largest(const pags_trainer *trainer, int *width, int *height);

/* Whether no pixel of the training photographs differs from another by more than a level of 255. Looks at photographs
 * until one does, which is the first for all but blank captures. */
pags_result pags_views_find_one_colour(pags_trainer *trainer, bool *out);

/* Returns the view of a photograph, by its number in the run from 1 (index of the data set's view), and its level, the
 * factor by which it is shrunk; tells the photo cache which views come next. */
int64_t pags_views_next(pags_trainer *trainer, int64_t photograph, int *level);

/* Returns the level of training view `index` at the last step done. */
int pags_views_level(const pags_trainer *trainer, int64_t index);
/* Returns the photograph of training view `index`, for code that looks at all training views in turn, at the level of
 * the last step done (`level` receives it); one process decodes the next ones meanwhile. At any other level, each
 * photograph would have to be decoded anew, and once more for the next step. */
pags_result pags_views_photo(pags_trainer *trainer, int64_t index, int *level, pags_photo *photo);

#endif
