/* SPDX-License-Identifier: Apache-2.0 */
/* The training views and the recording car's way as cameras and nodes of a glTF file. */
#ifndef PAGS_FORMAT_GLTF_CAMERAS_H
#define PAGS_FORMAT_GLTF_CAMERAS_H

#include <pags/scene.h>

#include "exporters/format/gltf.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Below `parent`, whose frame is the scene's relative to its origin: a node `cameras` with one of each view, held-out
 * ones too, and a node `ego` that moves as the first sensor does, x forward, y left, z up. `time_zero` is 0 in the
 * file. */
pags_result pags_gltf_add_views(pags_gltf *gltf, int parent, const pags_scene *scene, double time_zero);

#ifdef __cplusplus
}
#endif
#endif
