/* SPDX-License-Identifier: Apache-2.0 */
/* Recognises a KITTI folder tree (tracking benchmark or raw recording) and gives the paths of its files. */
#ifndef PAGS_IMPORT_KITTI_TREE_H
#define PAGS_IMPORT_KITTI_TREE_H

#include <pags/base.h>
#include <pags/import.h>
#include <stdbool.h>

#include "dataset/driving/account.h"

typedef struct pags_kitti_tree {
  bool raw;        /* a drive of a raw recording; else the tracking benchmark */
  char *root;      /* folder that holds image_02 etc.; raw: DATE/DATE_drive_NNNN_sync */
  char *sequence;  /* tracking: "0000"; raw: the drive's name */
  int cameras[16]; /* 0 = image_02, 1 = image_03 */
  int camera_count;
  int64_t frames;              /* number of frames of the whole sequence */
  int64_t first, last;         /* imported frames, both included */
  pags_account account;        /* omissions and their reasons */
  bool has_points, has_labels; /* whether there are any sweeps; whether there is a file of labels */
} pags_kitti_tree;

/* Recognises the tree at `path`, chooses the sequence and the frames, and checks that all files they need exist; one
 * error message lists all missing files. Sweeps and labels may be missing, which is logged; sweeps
 * and labels in another form, e.g. packed, are PAGS_ERROR_FORMAT. The caller closes the tree, also after a failure. */
pags_result pags_kitti_tree_open(const char *path, const pags_import_options *options, pags_kitti_tree *out);
void pags_kitti_tree_close(pags_kitti_tree *tree);

/* Paths of files, freed by the caller; NULL when out of memory. `frame` is the frame number of the source. */
char *pags_kitti_image_path(const pags_kitti_tree *tree, int camera, int64_t frame);
char *pags_kitti_points_path(const pags_kitti_tree *tree, int64_t frame);
char *pags_kitti_oxts_path(const pags_kitti_tree *tree, int64_t frame); /* tracking: one file for all frames */
char *pags_kitti_calib_path(const pags_kitti_tree *tree); /* raw: the folder of the day, which holds three files */
char *pags_kitti_labels_path(const pags_kitti_tree *tree);

#endif
