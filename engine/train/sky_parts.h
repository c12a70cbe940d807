/* SPDX-License-Identifier: Apache-2.0 */
/* The sky's gradient by a view that another rank may have drawn. Every rank has the whole sky and adds the gradients of
 * all views to it in their order, so that the sky stays the same everywhere. */
#ifndef PAGS_TRAIN_SKY_PARTS_H
#define PAGS_TRAIN_SKY_PARTS_H

#include "cluster/transport.h"
#include "train/sky_fit.h"

typedef struct pags_sky_parts {
  float *data;   /* the gradient of all blocks of texels; `seen` says which are set */
  uint8_t *seen; /* [blocks] */
  int64_t blocks;
  bool caught; /* the view has a gradient by the sky */
} pags_sky_parts;

/* Forgets the last view. */
void pags_sky_parts_begin(pags_sky_parts *parts);
/* Puts itself in the place of the gradient's receiver, if it has one. PAGS_ERROR_MEMORY. */
pags_result pags_sky_parts_catch(pags_sky_parts *parts, const pags_sky_fit *fit, pags_picture_gradient *gradient);
/* Collective: hands what the ranks have caught to the sky's receiver, rank after rank, at every rank. */
pags_result pags_sky_parts_add(pags_sky_parts *parts, pags_transport *transport, pags_sky_fit *fit,
                               const pags_schedule *schedule, int64_t step);
void pags_sky_parts_destroy(pags_sky_parts *parts);

#endif
