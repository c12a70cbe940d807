/* SPDX-License-Identifier: Apache-2.0 */
/* Adam's moments of a parameter of six numbers, as poses (rotation, translation) and exposures (gains, offsets) are. */
#ifndef PAGS_TRAIN_ADAM6_H
#define PAGS_TRAIN_ADAM6_H

#include <pags/train.h>

typedef struct pags_adam6 {
  double first[6], second[6];
  int64_t count; /* gradients so far, which is what the moments' bias is corrected by */
} pags_adam6;

/* Takes in a gradient and gives the direction to be subtracted, times a rate (Kingma and Ba). 0, and `step` unset,
 * where a number of the gradient is not finite: then nothing may move. */
int pags_adam6_step(pags_adam6 *moments, const double gradient[6], const pags_train_config *config, double step[6]);

#endif
