/* SPDX-License-Identifier: Apache-2.0 */
/* Writers of the text files of a synthetic street's data set: boxes, cameras, times, and the street's options. */
#ifndef PAGS_SYNTH_STREET_LABELS_H
#define PAGS_SYNTH_STREET_LABELS_H

#include "synth/street.h"

/* Gives a number to each actor that is labelled in some frame, because it is within 90 m of the ego vehicle there. */
void pags_street_number(pags_street *street);
/* Writes the boxes of all objects: instances/, with the noise of the options, and truth/instances/, exact. */
pags_result pags_street_write_instances(const pags_street *street, const char *folder);
pags_result pags_street_write_timestamps(const pags_street *street, const char *path);
pags_result pags_street_write_description(const pags_street *street, const char *path);
/* Writes a 4x4 matrix, one row a line. */
pags_result pags_street_write_pose(const char *path, const double pose[12]);
/* Writes fx fy cx cy and k1 k2 p1 p2 k3, of which all but k1 are 0; fx fy cx cy alone of a fisheye. */
pags_result pags_street_write_intrinsics(const char *path, const pags_camera *camera, double k1);

/* truth/street.json holds the options from which the same street can be built again. Reading takes the data set's
 * folder; without such a file *found is false and `out` the default options. */
pags_result pags_street_write_truth(const pags_street *street, const char *path);
pags_result pags_street_read_truth(const char *folder, pags_street_options *out, bool *found);

#endif
