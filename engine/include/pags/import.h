/* SPDX-License-Identifier: Apache-2.0 */
/* Importers: convert recordings of public driving data sets (KITTI, Waymo) to a data set in drivestudio's layout
 * (docs/dataset-layout.md), with a dataset.json in the same folder, which pags_dataset_open reads.
 *
 * An import that was stopped and is started again with the same source and folder continues: files that are
 * complete are kept. dataset.json is written last, so that an unfinished import is not taken for a data set. The member
 * "result" of import.json has the numbers of items written and of items left out, with reasons. To read none of the
 * sweeps or boxes that the source has, or to find them in another form than the source's own, is PAGS_ERROR_FORMAT.
 * Photographs are copied byte by byte, not encoded anew. */
#ifndef PAGS_IMPORT_H
#define PAGS_IMPORT_H

#include <pags/base.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

typedef struct pags_import_options {
  /* Numbers of the cameras to import, separated by commas. NULL: the usual cameras of the source, which are 0,1,2
   * for Waymo and, for KITTI, those of 0,1 (image_02 and image_03) that have photographs. */
  const char *cameras;
  int64_t frame_first, frame_last; /* frames to import, counted from 0, both included; frame_last -1 (default): to the
                                      end */
  const char *sequence;            /* KITTI: the sequence or drive, e.g. "0000"; NULL: the only one in the source */
  int overwrite;                   /* 1: write into a folder that holds something else. Default 0 */
} pags_import_options;

/* Returns the defaults: the usual cameras, all frames, the only sequence, no overwriting. */
PAGS_API pags_import_options pags_import_options_default(void);

/* Imports a KITTI tracking sequence or a KITTI raw drive into `folder`. `source` is the root of a KITTI tracking or
 * raw tree; which of the two is detected. `options` may be NULL (the defaults), and so may `progress`.
 *
 * PAGS_ERROR_ARGUMENT (unknown camera, no frame left, several sequences and none chosen), PAGS_ERROR_IO (files
 * are missing: the message names all of them; or `folder` holds something else and `overwrite` is 0),
 * PAGS_ERROR_FORMAT (damaged file), PAGS_ERROR_LIMIT, PAGS_ERROR_UNSUPPORTED, PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
PAGS_API pags_result pags_import_kitti(const char *source, const char *folder, const pags_import_options *options,
                                       pags_tasks *tasks, pags_progress_fn *progress, void *user);

/* Imports a segment of the Waymo Open Dataset v1, a .tfrecord file, into `folder`. A damaged record is an error
 * whose message gives the record's number and byte offset. Parameters and errors as pags_import_kitti. */
PAGS_API pags_result pags_import_waymo(const char *source, const char *folder, const pags_import_options *options,
                                       pags_tasks *tasks, pags_progress_fn *progress, void *user);

PAGS_END_C
#endif
