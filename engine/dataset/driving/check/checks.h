/* SPDX-License-Identifier: Apache-2.0 */
/* What is checked when a driving set is opened, beyond what its readers need: files that lie there but aren't read,
 * and values that can't be right or look wrong. Each check looks at a few files; it warns with one line a kind of
 * fault, or fails where nothing right can come of the data. */
#ifndef PAGS_DATASET_DRIVING_CHECK_CHECKS_H
#define PAGS_DATASET_DRIVING_CHECK_CHECKS_H

#include "dataset/driving/driving_set.h"
#include "dataset/driving/pictures.h"

/* Warns of files and folders that look like a part of the set but aren't read (unused_files.c). `list` is the listing
 * of images/, `pictures` all the photographs among it, sorted. */
pags_result pags_driving_say_unread(const pags_driving *driving, const pags_dir_list *list,
                                    const pags_driving_picture *pictures, int64_t count);

/* Fails for photographs of a camera that differ in size and for focal lengths that can't be pixels; warns of intrinsics
 * of another size and of cameras that don't stand upright (calibration.c). */
pags_result pags_calibration_check(const pags_driving *driving, const pags_parsed_dataset *parsed);

/* Warns if the world's z isn't up for the cameras, the car or the boxes, which must have been read (world.c). */
void pags_world_check(const pags_driving *driving, const pags_parsed_dataset *parsed);

/* Warns of masks and label images that look like none of their kind (masks.c); fails for one that can't be
 * loaded. */
pags_result pags_masks_check(const pags_driving *driving, const pags_parsed_dataset *parsed);

/* Refuses sweeps whose values can't be points in metres, or whose rows have another number of columns; with
 * `look`, counts the rows that are no points (sweeps.c). */
pags_result pags_sweeps_check(pags_driving *driving, bool look);

/* Warns if sweeps fit each other better without their poses, or with the inverse ones (overlap.c). */
pags_result pags_sweep_poses_check(const pags_driving *driving);

/* Warns of poses that leap: steps between neighbouring time steps that no car makes. */
pags_result pags_driving_check_motion(pags_driving *driving, const pags_parsed_dataset *parsed);
/* Warns of boxes that are too far from the cameras to have been seen. */
void pags_driving_check_places(const pags_driving *driving);

#endif
