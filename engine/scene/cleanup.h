/* SPDX-License-Identifier: Apache-2.0 */
/* Clean-up and look: rules that leave out Gaussians of a scene and change their colours and opacities. */
#ifndef PAGS_SCENE_CLEANUP_H
#define PAGS_SCENE_CLEANUP_H

#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Applies rules to a scene, one after another. `text` is JSON, an array of objects; `name` stands for it in messages.
 * docs/cleanup.md lists their members. PAGS_ERROR_FORMAT for what isn't a rule, PAGS_ERROR_ARGUMENT where no Gaussian
 * is left or where the scene has no views to count, PAGS_ERROR_MEMORY; then some rules may have been applied, and the
 * scene is only to be destroyed. */
pags_result pags_scene_cleanup(pags_scene *scene, const char *name, const char *text);

#ifdef __cplusplus
}
#endif
#endif
