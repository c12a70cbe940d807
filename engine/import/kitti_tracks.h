/* SPDX-License-Identifier: Apache-2.0 */
/* Converts KITTI's labels to tracks in world coordinates. */
#ifndef PAGS_IMPORT_KITTI_TRACKS_H
#define PAGS_IMPORT_KITTI_TRACKS_H

#include "dataset/driving/writer.h"
#include "import/kitti_files.h"

typedef struct pags_kitti_tracks {
  int64_t count;
  pags_layout_track *items;
} pags_kitti_tracks;

/* The imported frames; first, last and total are frame numbers of the source. */
typedef struct pags_kitti_span {
  int64_t first, last, total;          /* first and last included; total: number of frames of the whole sequence */
  const double *times;                 /* seconds, one per frame from `first` on */
  const double (*world_from_velo)[12]; /* of each frame from `first` on */
  pags_account *account;               /* omissions are added to it; NULL: nowhere */
} pags_kitti_span;

/* Make tracks from the boxes of the imported frames; other boxes, and tracks without a box in these frames, are left
 * out. None of all boxes in these frames is PAGS_ERROR_FORMAT. A warning tells of labels past the last photograph, of
 * labels without a size, of scores, and of track numbers whose classes differ: each class is an object of its own,
 * unless one object of one category goes by two names (a car and a van). The id of an object is its track number, or
 * "NUMBER-Class" for the second and further classes. Whether an object moves is decided from its poses in these frames.
 * `path` is used in messages. The caller destroys the tracks, also after a failure. */
pags_result pags_kitti_tracks_from_labels(const char *path, const pags_kitti_labels *labels,
                                          const double cam0_from_velo[12], const pags_kitti_span *span,
                                          pags_kitti_tracks *out);
pags_result pags_kitti_tracks_from_tracklets(const char *path, const pags_kitti_tracklets *tracklets,
                                             const pags_kitti_span *span, pags_kitti_tracks *out);
void pags_kitti_tracks_destroy(pags_kitti_tracks *tracks);

#endif
