/* SPDX-License-Identifier: Apache-2.0 */
/* Importers: recordings of driving data sets to drivestudio's layout (docs/dataset-layout.md), with dataset.json beside
 * it.
 *
 * Work that was stopped and is begun again with the same source goes on where it was: files that are complete stay,
 * dataset.json comes last. Photographs are copied byte by byte. */
#ifndef PAGS_IMPORT_H
#define PAGS_IMPORT_H

#include <pags/base.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_import_options {
  const char *cameras; /* numbers separated by commas; NULL: the source's usual ones (Waymo 0,1,2; KITTI 0,1 = image_02,
                          image_03) */
  int64_t frame_first, frame_last; /* both included; frame_last -1 (default): to the end */
  const char *sequence;            /* KITTI tracking: "0000"; NULL: the only one there is */
  int overwrite;                   /* 1: write into a folder that holds something else. Default 0 */
} pags_import_options;

PAGS_API pags_import_options pags_import_options_default(void);

/* `source`: the root of a KITTI tracking or raw tree; which of the two is found out. Missing files are named, all of
 * them. */
PAGS_API pags_result pags_import_kitti(const char *source, const char *folder, const pags_import_options *options,
                                       pags_tasks *tasks, pags_progress_fn *progress, void *user);

/* `source`: a Waymo Open Dataset v1 segment, .tfrecord. A record that is damaged is refused with its number and offset.
 */
PAGS_API pags_result pags_import_waymo(const char *source, const char *folder, const pags_import_options *options,
                                       pags_tasks *tasks, pags_progress_fn *progress, void *user);

#ifdef __cplusplus
}
#endif
#endif
