/* SPDX-License-Identifier: Apache-2.0 */
/* Adds the views of a scene and the path of the ego vehicle to a glTF file, as cameras and as an animated node. */
#ifndef PAGS_FORMAT_GLTF_CAMERAS_H
#define PAGS_FORMAT_GLTF_CAMERAS_H

#include <pags/scene.h>

#include "exporters/format/gltf.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Adds two nodes below `parent`: `cameras`, with a camera node for every view (held-out views, too), and `ego`, the ego
 * vehicle, animated with the poses of the camera with the lowest number, turned to x forward, y left, z up. Positions
 * below `parent` are those of the scene relative to its origin. `time_zero` is the scene's time, in seconds, that is 0
 * in the file. */
pags_result pags_gltf_add_views(pags_gltf *gltf, int parent, const pags_scene *scene, double time_zero);

#ifdef __cplusplus
}
#endif
#endif
