/* SPDX-License-Identifier: Apache-2.0 */
/* A block of a recording: block.json, which names the data set of the whole drive, the time steps that the block is
 * trained on and how the data set was opened when it was split (docs/blocks.md). Nothing is copied: photographs, masks
 * and sweeps are the recording's own files. */
#ifndef PAGS_DATASET_BLOCK_H
#define PAGS_DATASET_BLOCK_H

#include <stdbool.h>

#include <pags/dataset.h>

#include "dataset/parsed.h"

#define PAGS_BLOCK_FILE "block.json"
#define PAGS_SPLIT_FILE "split.json"

enum { PAGS_BLOCK_TEXTS = 6 }; /* options of pags_dataset_options that are text and stay the recording's */

typedef struct pags_block_file {
  pags_block facts; /* strings are those below */
  char *path;       /* of block.json; NULL: nothing was read */
  char *split, *recording, *whole;
  char *texts[PAGS_BLOCK_TEXTS];
} pags_block_file;

/* Whether `path` is a folder with a block.json, or a block.json. */
bool pags_block_is(const char *path);

/* Reads the block.json at or in `path`, and sets in `options` what it states of the recording, which points into `out`
 * from then on. PAGS_ERROR_ARGUMENT if the options have another value for one of these already, or choose time steps.
 * `out` must be destroyed on failure, too. */
pags_result pags_block_read(const char *path, pags_block_file *out, pags_dataset_options *options);
void pags_block_file_destroy(pags_block_file *block);

/* Writes block.json into the folder, which is created if missing. block->whole is written as it is; relative, it counts
 * from the folder. Paths among the options become absolute. */
pags_result pags_block_write(const char *folder, const pags_block *block, const pags_dataset_options *options);

/* Leaves only the views and sweeps of the block's time steps, and the objects with a label in them. Tracks stay whole,
 * so that all blocks agree on what moves; their labels at other time steps count as held out. */
pags_result pags_block_cut(const pags_block *block, pags_parsed_dataset *parsed);

#endif
