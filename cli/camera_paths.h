/* SPDX-License-Identifier: Apache-2.0 */
/* Camera paths made from a scene: an orbit, and a flight through its training cameras. */
#ifndef PAGS_CLI_CAMERA_PATHS_H
#define PAGS_CLI_CAMERA_PATHS_H

#include <pags/scene.h>
#include <stdbool.h>

/* `frames` cameras that circle what the scene shows, upright, looking at its middle; the last leads back to the first.
 * With views: around the point their axes pass nearest to, at their typical distance and height, within the arc they
 * cover. Without: around the median of the Gaussians. Of a drive: from above, around its middle. 30 frames a second. */
pags_result pags_camera_path_orbit(const pags_scene *scene, int64_t frames, pags_camera_path *out);

/* The training views themselves, maybe none. */
pags_result pags_camera_path_views(const pags_scene *scene, pags_camera_path *out);

/* `frames` cameras on a smooth curve through the training views in their order, at even speed. An error when the scene
 * has fewer than 2. */
pags_result pags_camera_path_ego(const pags_scene *scene, int64_t frames, pags_camera_path *out);

/* Whether the scene's views know which sensor took them and when: a drive rather than a walk round something. */
bool pags_scene_is_drive(const pags_scene *scene);

/* The path that the sensor with the lowest number was driven along, through training and held-out views, with time
 * running: `frames` cameras evenly spaced in time; frames 0: `fps` cameras a second; both 0: the recorded cameras. An
 * error where fewer than 2 cameras were recorded. */
pags_result pags_camera_path_drive(const pags_scene *scene, int64_t frames, double fps, pags_camera_path *out);

/* That sensor's number; -1: the scene is no drive. */
int pags_camera_path_drive_sensor(const pags_scene *scene);

/* Every camera so many metres to its own right, negative to its left. */
void pags_camera_path_shift(pags_camera_path *path, double metres);

#endif
