/* SPDX-License-Identifier: Apache-2.0 */
/* The training views: which they are, in which order and at which size they are seen, and their photographs. */
#ifndef PAGS_TRAIN_VIEWS_H
#define PAGS_TRAIN_VIEWS_H

#include "train/run.h"

/* Views announced to the photo cache ahead of use. */
enum { PAGS_TRAIN_AHEAD = 32 };

/* The training views and their fingerprint, by which a checkpoint is known to belong to them. */
pags_result pags_views_list(pags_trainer *trainer);

/* The view of `step` (of the data set) and its level; the photo cache is told which come next. */
int64_t pags_views_next(pags_trainer *trainer, int64_t step, int *level);

/* The photograph of training view `index` as training sees it at the step done, for what looks at all of them in turn:
 * those that follow are decoded meanwhile. At any other level than `*level` each would have to be decoded anew, and
 * again for the next step. */
pags_result pags_views_photo(pags_trainer *trainer, int64_t index, int *level, pags_photo *photo);

#endif
