/* SPDX-License-Identifier: Apache-2.0 */
/* Which files a KITTI tree has: of the tracking benchmark, or of a raw recording. */
#ifndef PAGS_IMPORT_KITTI_TREE_H
#define PAGS_IMPORT_KITTI_TREE_H

#include <pags/base.h>
#include <pags/import.h>
#include <stdbool.h>

typedef struct pags_kitti_tree {
  bool raw;        /* a drive of a raw recording; else the tracking benchmark */
  char *root;      /* folder of image_02 and so on; raw: DATE/DATE_drive_NNNN_sync */
  char *sequence;  /* tracking: "0000"; raw: the drive's name */
  int cameras[16]; /* 0 = image_02, 1 = image_03 */
  int camera_count;
  int64_t frames;              /* of the whole sequence */
  int64_t first, last;         /* used */
  bool has_points, has_labels; /* some sweeps, the file of labels */
} pags_kitti_tree;

/* Finds out which tree `path` is, the sequence and the frames, and that every file needed of them is there: all that
 * are missing stand in one message. Sweeps and labels may be missing; a log line says so. */
pags_result pags_kitti_tree_open(const char *path, const pags_import_options *options, pags_kitti_tree *out);
void pags_kitti_tree_close(pags_kitti_tree *tree);

/* Paths, freed by the caller; NULL when memory is out. Frames are the source's numbers. */
char *pags_kitti_image_path(const pags_kitti_tree *tree, int camera, int64_t frame);
char *pags_kitti_points_path(const pags_kitti_tree *tree, int64_t frame);
char *pags_kitti_oxts_path(const pags_kitti_tree *tree, int64_t frame); /* tracking: one file for all frames */
char *pags_kitti_calib_path(const pags_kitti_tree *tree);               /* raw: the folder of the day's three files */
char *pags_kitti_labels_path(const pags_kitti_tree *tree);
/* raw: "image_02/timestamps.txt" and the like. */
char *pags_kitti_times_path(const pags_kitti_tree *tree, const char *name);

#endif
