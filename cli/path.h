/* Camera paths made from a scene: an orbit, and a flight through its training cameras. */
#ifndef PAGS_CLI_PATH_H
#define PAGS_CLI_PATH_H

#include <pags/scene.h>

/* `frames` cameras that circle what the scene shows, upright, looking at its middle; the last leads back to the first.
 * With views: around the point their axes pass nearest to, at their typical distance and height, within the arc they
 * cover. Without: around the median of the Gaussians. 30 frames a second. */
pags_result pags_path_orbit(const pags_scene *scene, int64_t frames, pags_path *out);

/* `frames` cameras on a smooth curve through the training views in their order, at even speed. An error when the scene
 * has fewer than 2. */
pags_result pags_path_ego(const pags_scene *scene, int64_t frames, pags_path *out);

#endif
