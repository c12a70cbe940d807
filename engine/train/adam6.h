/* SPDX-License-Identifier: Apache-2.0 */
/* The Adam optimiser (Kingma and Ba 2015) of a parameter of six numbers: a pose (rotation, translation) or an
 * exposure (three gains, three offsets). */
#ifndef PAGS_TRAIN_ADAM6_H
#define PAGS_TRAIN_ADAM6_H

#include <stdbool.h>

#include <pags/train.h>

typedef struct pags_adam6 {
  double first[6], second[6];
  int64_t count; /* number of gradients to date, for the bias correction of the moments */
} pags_adam6;

/* Updates the moments with a gradient. `step` receives Adam's direction m / (sqrt v + 1e-15), bias-corrected; the
 * caller subtracts it times a learning rate. Returns 1; or 0, with the moments and `step` unchanged, if a number of
 * the gradient isn't finite (|g| >= 1e150 counts as not finite): then the parameter must not move. */
bool pags_adam6_step(pags_adam6 *moments, const double gradient[6], const pags_train_config *config, double step[6]);

#endif
