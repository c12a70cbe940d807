/* SPDX-License-Identifier: Apache-2.0 */
/* Long recordings in blocks (docs/blocks.md): a driving set is cut along the drive into blocks that overlap, each is
 * trained by itself as a data set of its own (pags_dataset_block), and the scenes are merged into one.
 *
 * Block-NeRF (Tancik et al. 2022) and VastGaussian (Lin et al. 2024) cut scenes so; here the cut goes along the drive.
 * A place belongs to the cell of the block whose own time steps brought the rig nearest to it. Merging keeps the
 * Gaussians of each block that lie in its cell; the others are ghosts, which model what its photographs show beyond it.
 */
#ifndef PAGS_BLOCKS_H
#define PAGS_BLOCKS_H

#include <pags/base.h>
#include <pags/dataset.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

/* How a recording is cut. Time steps are numbers of frames. */
typedef struct pags_blocks {
  char id[17];     /* a hash of the recording's views and of the cut, hexadecimal */
  char *recording; /* absolute path of the data set */
  double length;   /* metres of the drive, along the rig's path */
  double block;    /* metres of a block: equal parts of the drive */
  double overlap;  /* metres that a block is trained on beyond either of its ends */
  int count;
  /* Of each block: the first and the last time step that it is trained on, and of those that are its own. */
  struct pags_block_range {
    int first, last, own_first, own_last;
  } *ranges;
  int64_t stand_count; /* time steps */
  int *frames;         /* their numbers, ascending */
  double (*stands)[3]; /* where the rig stood: the mean of its cameras' positions, metres */
} pags_blocks;

/* Cuts a driving set into as few equal blocks of at most `length` metres as there can be. `overlap` is in metres.
 * PAGS_ERROR_ARGUMENT if `length` isn't positive or `overlap` is negative, if the data set isn't a driving set or is a
 * block itself, or if a block would have no training view. The split must be destroyed on failure, too. */
PAGS_API pags_result pags_blocks_plan(const pags_dataset *dataset, double length, double overlap, pags_blocks *split);

PAGS_API void pags_blocks_destroy(pags_blocks *split); /* a zeroed one is allowed */

/* Writes split.json, the description of the blocks. */
PAGS_API pags_result pags_blocks_save(const pags_blocks *split, const char *folder);

/* Reads the split.json of a folder. PAGS_ERROR_IO if it has none, PAGS_ERROR_FORMAT. The split must be destroyed on
 * failure, too. */
PAGS_API pags_result pags_blocks_load(const char *folder, pags_blocks *split);

/* Writes the folders of the blocks, FOLDER/000 and so on, each with a block.json and nothing else: what they are of is
 * read where it lies. `options` is how the data set was opened. `whole` is a scene of the whole recording that gives
 * all blocks one sky and one mean exposure, absolute or relative to a block's folder; NULL: each has its own. */
PAGS_API pags_result pags_blocks_write(const pags_blocks *split, const char *folder,
                                       const pags_dataset_options *options, const char *whole);

/* What merging did. */
typedef struct pags_merge_facts {
  int blocks;
  int64_t gaussians;      /* of the merged scene */
  int64_t ghosts;         /* Gaussians that were left out, since they lie in the cell of another block */
  int64_t object_models;  /* objects with a model of their own */
  int64_t objects, views; /* of the merged scene */
} pags_merge_facts;

/* Merges the scenes FOLDER/000/scene and so on of a split into a scene in `output`, whose data set is the recording. A
 * moving object comes whole, with its track, from the block whose photographs show most of it; a parked one's Gaussians
 * come from the block in whose cell its box is; a view's exposure is that of the block whose own it is. Nothing is
 * written before all is merged.
 *
 * PAGS_ERROR_FORMAT (a block without a scene, or with one of another split or block; scenes of unfinished runs, or that
 * were trained with different options, on pictures of different size or with other views held out), PAGS_ERROR_IO,
 * PAGS_ERROR_MEMORY, PAGS_CANCELLED. `progress` may be NULL. */
PAGS_API pags_result pags_merge(const char *folder, const char *output, pags_tasks *tasks, pags_progress_fn *progress,
                                void *user, pags_merge_facts *facts);

PAGS_END_C
#endif
