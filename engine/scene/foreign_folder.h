/* SPDX-License-Identifier: Apache-2.0 */
/* Folders of other programs that are scenes: the output of INRIA's train.py (Kerbl et al. 2023) and of programs that
 * write the same (point_cloud/iteration_N/point_cloud.ply, cameras.json, cfg_args), one iteration's folder of it, and a
 * SOG (meta.json and its pictures). */
#ifndef PAGS_SCENE_FOREIGN_FOLDER_H
#define PAGS_SCENE_FOREIGN_FOLDER_H

#include <pags/scene.h>

/* Names the kind of folder, a static string; NULL: it is none of them. */
const char *pags_foreign_folder_kind(const char *folder);

/* Finds the file with the Gaussians, relative to the folder, freed by the caller: of several iterations the newest.
 * What was passed over goes to the log. PAGS_ERROR_IO, PAGS_ERROR_FORMAT or PAGS_ERROR_MEMORY. */
pags_result pags_foreign_folder_find(const char *folder, char **file);

/* Adds the views of cameras.json and the background of cfg_args to the scene, where the folder has them. */
pags_result pags_foreign_folder_views(const char *folder, pags_scene *scene);

#endif
