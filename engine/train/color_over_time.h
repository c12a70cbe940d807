/* SPDX-License-Identifier: Apache-2.0 */
/* Which objects' colours change over time. */
#ifndef PAGS_TRAIN_COLOR_OVER_TIME_H
#define PAGS_TRAIN_COLOR_OVER_TIME_H

struct pags_trainer;

#include <pags/base.h>

/* Draws every training view as trained so far and asks, per moving object, how much of its error a colour that varies
 * over the track as five Fourier terms would take away: the mean error of its pixels at each time step, fitted by least
 * squares. Objects for which that promises at least fourier_gain dB get the terms, at zero. Everything must be settled.
 */
pags_result pags_color_over_time_decide(struct pags_trainer *trainer);

#endif
