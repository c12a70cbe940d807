/* SPDX-License-Identifier: Apache-2.0 */
/* Reads a driving set in drivestudio's processed layout, part by part. */
#ifndef PAGS_DATASET_DRIVING_READER_H
#define PAGS_DATASET_DRIVING_READER_H

#include "dataset/driving/driving_set.h"

/* Whether the folder is a driving set: it has dataset.json, or images together with ego_pose or extrinsics. */
bool pags_driving_is_set(const char *folder);
/* Reads the driving set in `folder`. The caller destroys the parsed set, also on failure. */
pags_result pags_driving_read(const char *folder, const pags_dataset_options *options, pags_parsed_dataset *parsed);

/* Reads the conventions of a set (rules.c). `kind`: the caller's choice; NULL: as dataset.json says.
 * `per_frame_files`: the set has extrinsics named TTT_C, which identify PandaSet's kind if neither the caller nor
 * dataset.json names one. The names of cameras and the lenses that dataset.json has are passed to `take`: one of `name`
 * and `lens`, which is checked, at a time; the other is NULL. */
typedef pags_result pags_camera_fact_fn(void *context, int number, const char *name, const pags_lens_model *lens);
pags_result pags_rules_read(const char *root, const char *kind, bool per_frame_files, pags_rules *rules,
                            pags_camera_fact_fn *take, void *context);

/* Reads the rules of a set for programs that read its sweeps themselves. Fails if the columns of a sweep aren't known.
 */
pags_result pags_sweep_rules_read(const char *root, pags_rules *rules);

/* Reads the times of the steps and of the exposures from timestamps.json or, without that file, sets the time of
 * frame t to t / fps. Also sets driving->fps. */
pags_result pags_times_read(pags_driving *driving, pags_parsed_dataset *parsed);
/* Reads the direction of the cameras' rolling shutters from dataset.json and the times of their read-outs from
 * timestamps.json, and finds the cameras' velocities from their poses (rolling.c). */
pags_result pags_rolling_read(pags_driving *driving, pags_parsed_dataset *parsed);
/* Reads the objects with their keyframes at the used time steps from instances/ (tracks.c). */
pags_result pags_tracks_read(pags_driving *driving);
/* Reads the objects from the file of Street Gaussians (street_tracks.c). */
#define PAGS_STREET_TRACKS "track/track_info.txt"
pags_result pags_street_tracks_read(pags_driving *driving);
/* Finds the sweep of each time step in lidar/ and reads its pose. */
pags_result pags_sweeps_find(pags_driving *driving);
/* Returns what format a file begins as that is no plain rows of floats, in words; NULL: none that is known. */
const char *pags_sweep_format(const char *path);

/* Rows of a sweep that are no points. */
typedef struct pags_sweep_rows {
  int64_t all;
  int64_t not_finite;
  int64_t no_return; /* at the scanner, or one of many at the same place: a beam that met nothing */
  int64_t far;       /* farther from the car than PAGS_FARTHEST */
} pags_sweep_rows;

enum { PAGS_FARTHEST = 1000 }; /* metres: no LiDAR of cars sees as far */

/* Reads the points of a sweep: 3 floats per point, in the frame of the sweep. Rows that are no points are left out, and
 * counted in `rows`, which may be NULL. The caller frees *xyz. */
pags_result pags_sweep_read(const pags_driving *driving, int64_t index, int64_t *count, float **xyz,
                            pags_sweep_rows *rows);

/* Reads the points of a COLMAP model in the same world and makes them the points of the parsed set. */
pags_result pags_sfm_points_read(const char *model, pags_parsed_dataset *parsed);

/* Reads all numbers of a text file, separated by blanks, line breaks or commas; more than `capacity` numbers are an
 * error. */
pags_result pags_text_matrix_read(const char *path, int capacity, double *out, int *count);
/* Reads a rigid motion of 4x4 or 3x4 numbers from a text file. */
pags_result pags_text_pose_read(const char *path, double out[12]);
/* Whether there is no pose: the file doesn't exist, is empty, or holds numbers that aren't finite, as programs write
 * for the frames of which they know none. */
bool pags_text_pose_is_missing(const char *path);
#endif
