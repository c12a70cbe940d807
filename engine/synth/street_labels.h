/* SPDX-License-Identifier: Apache-2.0 */
/* The street's texts: boxes, cameras, times. */
#ifndef PAGS_SYNTH_STREET_LABELS_H
#define PAGS_SYNTH_STREET_LABELS_H

#include "synth/street.h"

/* Numbers the actors that are ever labelled: those within reach of the recording car in some frame. */
void pags_street_number(pags_street *street);
/* instances_info.json; with pose noise as the options ask, or exact. */
pags_result pags_street_write_instances(const pags_street *street, const char *path, int exact);
pags_result pags_street_write_frame_instances(const pags_street *street, const char *path);
pags_result pags_street_write_timestamps(const pags_street *street, const char *path);
pags_result pags_street_write_description(const pags_street *street, const char *path);
/* 4x4, a row a line. */
pags_result pags_street_write_pose(const char *path, const double pose[12]);
pags_result pags_street_write_intrinsics(const char *path, const pags_camera *camera);

/* What the street is made from. Read from a data set's folder: *found = 0 and the default options where there is none.
 */
pags_result pags_street_write_truth(const pags_street *street, const char *path);
pags_result pags_street_read_truth(const char *folder, pags_street_options *out, int *found);

#endif
