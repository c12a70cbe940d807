/* SPDX-License-Identifier: Apache-2.0 */
/* Decides which moving objects get a colour that changes over time. */
#ifndef PAGS_TRAIN_COLOR_OVER_TIME_H
#define PAGS_TRAIN_COLOR_OVER_TIME_H

struct pags_trainer;

#include <pags/base.h>

/* Renders every training view with the current Gaussians and estimates, per moving object, how much of its
 * error a colour that varies over the track as five Fourier terms would remove: the mean error of the object's pixels
 * at each time step is fitted by least squares. Objects for which the fit promises at least fourier_gain dB get the
 * Fourier terms, all zero. No model may have pending Adam steps. */
pags_result pags_color_over_time_decide(struct pags_trainer *trainer);

#endif
