/* SPDX-License-Identifier: Apache-2.0 */
/* How much each Gaussian contributes to pictures of the scene: the sum of its weights alpha T over their pixels. */
#ifndef PAGS_CLI_SCENE_HTML_CONTRIBUTION_H
#define PAGS_CLI_SCENE_HTML_CONTRIBUTION_H

#include <pags/camera.h>
#include <pags/compose.h>
#include <pags/tasks.h>

/* Adds up the contributions over at most 48 cameras of the path, drawn at no more than 640 pixels a side: weight[id],
 * room for all Gaussians. The same bits for any number of threads. PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_contribution_measure(pags_composition *composition, const pags_camera_path *path, pags_tasks *tasks,
                                      pags_progress_fn *progress, void *user, float *weight);

#endif
