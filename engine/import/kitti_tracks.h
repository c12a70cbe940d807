/* SPDX-License-Identifier: Apache-2.0 */
/* KITTI's labels as tracks in the world. */
#ifndef PAGS_IMPORT_KITTI_TRACKS_H
#define PAGS_IMPORT_KITTI_TRACKS_H

#include "dataset/driving/writer.h"
#include "import/kitti_files.h"

typedef struct pags_kitti_tracks {
  int64_t count;
  pags_layout_track *items;
} pags_kitti_tracks;

/* The frames that are used, by their numbers in the source. */
typedef struct pags_kitti_span {
  int64_t first, last, total;          /* total: frames of the whole sequence */
  const double *times;                 /* of each frame from `first` on */
  const double (*world_from_velo)[12]; /* of each frame from `first` on */
} pags_kitti_span;

/* Boxes of the used frames; the others are left out, and tracks without any. `path` is for messages. The object that
 * moves is told from the one that doesn't by its poses in these frames. */
pags_result pags_kitti_tracks_from_labels(const char *path, const pags_kitti_labels *labels,
                                          const double cam0_from_velo[12], const pags_kitti_span *span,
                                          pags_kitti_tracks *out);
pags_result pags_kitti_tracks_from_tracklets(const char *path, const pags_kitti_tracklets *tracklets,
                                             const pags_kitti_span *span, pags_kitti_tracks *out);
void pags_kitti_tracks_destroy(pags_kitti_tracks *tracks);

#endif
