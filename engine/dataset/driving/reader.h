/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a driving set in drivestudio's processed layout, and the parts that it is read in. */
#ifndef PAGS_DATASET_DRIVING_READER_H
#define PAGS_DATASET_DRIVING_READER_H

#include "dataset/driving/driving_set.h"

/* A folder that has what only this layout has: dataset.json, or images with ego_pose or extrinsics. */
bool pags_driving_is_set(const char *folder);
/* Leaves an empty parsed set on failure. */
pags_result pags_driving_read(const char *folder, const pags_dataset_options *options, pags_parsed_dataset *parsed);

/* `kind` as asked for, NULL: as dataset.json says. `per_frame_files`: there are extrinsics named TTT_C, which settles
 * the kind where neither says it. Names of cameras, as far as dataset.json has them, go to `names(context, number,
 * name)`. */
typedef pags_result pags_camera_name_fn(void *context, int number, const char *name);
pags_result pags_rules_read(const char *root, const char *kind, bool per_frame_files, pags_rules *rules,
                            pags_camera_name_fn *name, void *context);

/* timestamps.json, or t / fps. Fills in the steps' times and driving->fps. */
pags_result pags_times_read(pags_driving *driving, pags_parsed_dataset *parsed);
/* instances/: objects with their knots at the steps. */
pags_result pags_tracks_read(pags_driving *driving);
/* lidar/: the sweeps of the steps. */
pags_result pags_sweeps_find(pags_driving *driving);
pags_result pags_sweep_read(const pags_driving *driving, int64_t index, int64_t *count, float **xyz);

/* The points of a COLMAP model in the same world are added to the parsed set's. */
pags_result pags_sfm_points_read(const char *model, pags_parsed_dataset *parsed);

/* All numbers of a text file, separated by blanks, line breaks or commas; at most `capacity`. */
pags_result pags_text_matrix_read(const char *path, int capacity, double *out, int *count);
/* A rigid motion as 4x4 or 3x4 numbers. */
pags_result pags_text_pose_read(const char *path, double out[12]);

#endif
