/* SPDX-License-Identifier: Apache-2.0 */
/* Channels that are computed from a picture's own planes. */
#ifndef PAGS_CLI_CHANNELS_H
#define PAGS_CLI_CHANNELS_H

#include <pags/compose.h>

/* Unit normals in world axes, towards the camera, of the surface that the depth plane describes; three planes of the
 * picture's stride. 0 where there is no depth, or none beside it. */
void pags_normals_from_depth(const pags_picture *picture, const pags_camera *camera, float *const out[3]);

#endif
