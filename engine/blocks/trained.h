/* SPDX-License-Identifier: Apache-2.0 */
/* The scenes that the blocks of a split were trained to, without their Gaussians, and whether they fit together. */
#ifndef PAGS_BLOCKS_TRAINED_H
#define PAGS_BLOCKS_TRAINED_H

#include <pags/blocks.h>
#include <pags/scene.h>

typedef struct pags_trained {
  int count;
  char **folders;    /* FOLDER/000/scene, ... */
  pags_scene *heads; /* what their scene.json say; models have no Gaussians */
} pags_trained;

/* Reads the scene.json of every block and checks that all are there, belong to this split, were trained to the end and
 * in the same way. Errors as pags_merge. Must be destroyed on failure, too. */
pags_result pags_trained_load(const pags_blocks *split, const char *folder, pags_trained *trained);
void pags_trained_destroy(pags_trained *trained);

#endif
