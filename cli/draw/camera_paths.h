/* SPDX-License-Identifier: Apache-2.0 */
/* Computes camera paths from a scene: an orbit, a smooth flight through the training views, and the recorded drive.
 * Describes a scene for pages: scene.json of pags view, and the header of scene.html. */
#ifndef PAGS_CLI_CAMERA_PATHS_H
#define PAGS_CLI_CAMERA_PATHS_H

#include <pags/compose.h>
#include <pags/scene.h>
#include <stdbool.h>
#include "base/json.h"
#include "scene/survey.h"

/* Makes an orbit of `frames` upright cameras at 30 frames/s that look at a centre. The path closes, or returns along
 * the arc that the photographs cover. With photographs: around the point nearest to their optical axes, near their
 * cameras. Without: around the whole scene, as near as possible with all of it in the picture, or inside the closed
 * room that it forms. For a drive: from above, around a place ahead of its middle. `stand` other than PAGS_STAND_AUTO
 * forces outside or inside. The camera avoids solid cells. */
pags_result pags_camera_path_orbit(const pags_scene *scene, int64_t frames, pags_stand stand, pags_camera_path *out);

/* The mean of the cameras' up axes, a unit vector, if they agree; else the up axis of the scene. */
void pags_cameras_up(const pags_scene *scene, double out[3]);

/* Lists the cameras of the training views, unchanged; may be none. */
pags_result pags_camera_path_views(const pags_scene *scene, pags_camera_path *out);

/* Makes `frames` cameras at constant speed on a smooth curve through the training views in their order. Fails if the
 * scene has fewer than 2. */
pags_result pags_camera_path_ego(const pags_scene *scene, int64_t frames, pags_camera_path *out);

/* Whether any view records its sensor and its time, which makes the scene a drive rather than a set of photographs
 * around an object. */
bool pags_scene_is_drive(const pags_scene *scene);

/* Makes the recorded path of the sensor with the lowest number, through its training and held-out views, with time
 * running: `frames` cameras evenly spaced in time; if frames is 0, `fps` cameras a second; if both are 0, the
 * recorded cameras. Fails if fewer than 2 cameras were recorded. */
pags_result pags_camera_path_drive(const pags_scene *scene, int64_t frames, double fps, pags_camera_path *out);

/* Returns the number of the sensor that pags_camera_path_drive follows; -1 if the scene is no drive. */
int pags_camera_path_drive_sensor(const pags_scene *scene);

/* Makes a path of `frames` zeroed cameras. */
pags_result pags_camera_path_create(int64_t frames, pags_camera_path *out);

/* Moves every camera `metres` to its own right; negative moves to the left. */
void pags_camera_path_shift(pags_camera_path *path, double metres);

/* ---- Description for pages ---- */

/* Start camera of a page; found while the scene still has its Gaussians. */
typedef struct pags_view_start {
  pags_camera camera;
  double up[3];    /* unit, world */
  double distance; /* metres from the camera to its subject */
} pags_view_start;

/* The first recorded camera of a drive, or the first of an orbit. Errors of pags_camera_path_orbit. */
pags_result pags_view_start_find(const pags_scene *scene, pags_view_start *out);

/* Writes the description; the text is out->data, and the caller destroys the writer. `name`: name of the scene; `live`:
 * it belongs to a running training and changes. PAGS_ERROR_MEMORY. */
pags_result pags_view_describe(const pags_composition *composition, const pags_view_start *start, const char *name,
                               bool live, pags_json_writer *out);

#endif
