/* SPDX-License-Identifier: Apache-2.0 */
/* Output channels that are computed from a picture's planes. */
#ifndef PAGS_CLI_CHANNELS_H
#define PAGS_CLI_CHANNELS_H

#include <pags/compose.h>

/* Computes unit normals of the surface that the depth plane describes, in world axes and facing the camera, into
 * three planes with the picture's stride. A normal is 0 at pixels without depth or without neighbours that have
 * depth. */
void pags_normals_from_depth(const pags_picture *picture, const pags_camera *camera, float *const out[3]);

#endif
