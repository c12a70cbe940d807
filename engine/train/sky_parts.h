/* SPDX-License-Identifier: Apache-2.0 */
/* The sky of a run that several ranks share. Each has all texels; a block of them is updated by the rank that owns it
 * (pags_sky_fit), which adds the gradients of all views to it in their order, and which tells the others the texels
 * that have moved. */
#ifndef PAGS_TRAIN_SKY_PARTS_H
#define PAGS_TRAIN_SKY_PARTS_H

#include <stdatomic.h>

#include "cluster/transport.h"
#include "train/sky_fit.h"

/* A block on its way: its gradient, or its texels. */
typedef struct pags_sky_part {
  int64_t block;
  float data[3 * PAGS_SKY_BLOCK];
} pags_sky_part;

typedef struct pags_sky_parts {
  pags_sky_part *caught_blocks; /* of the own view, in no order */
  atomic_llong count;
  bool caught;    /* the view has a gradient by the sky */
  uint8_t *moved; /* per own block: it has got a gradient in this step */
} pags_sky_parts;

/* Forgets the last view. */
void pags_sky_parts_begin(pags_sky_parts *parts);
/* Puts itself in the place of the gradient's receiver, if it has one. PAGS_ERROR_MEMORY. */
pags_result pags_sky_parts_catch(pags_sky_parts *parts, const pags_sky_fit *fit, pags_picture_gradient *gradient);
/* Collective: hands what the ranks have caught to the owners' receivers, rank after rank. */
pags_result pags_sky_parts_add(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit,
                               const pags_schedule *schedule, int64_t step);
/* Collective, at the end of a step: brings the texels that have moved to all ranks. */
pags_result pags_sky_parts_spread(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit);
void pags_sky_parts_destroy(pags_sky_parts *parts);

#endif
