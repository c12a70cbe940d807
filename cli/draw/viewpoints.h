/* SPDX-License-Identifier: Apache-2.0 */
/* The list of cameras that a verb renders, each with the name of its picture. */
#ifndef PAGS_CLI_VIEWPOINTS_H
#define PAGS_CLI_VIEWPOINTS_H

#include <pags/dataset.h>
#include <pags/scene.h>

typedef struct pags_viewpoint {
  char *name; /* file name of the picture, without folder and extension */
  pags_camera camera;
  double gain[3], offset[3];    /* exposure of the camera at that moment; 1 and 0 if unknown */
  pags_photometric photometric; /* of the camera; zeros if unknown */
} pags_viewpoint;

typedef struct pags_viewpoints {
  int64_t count;
  pags_viewpoint *items;
} pags_viewpoints;

typedef enum pags_split { PAGS_SPLIT_TRAIN, PAGS_SPLIT_TEST, PAGS_SPLIT_ALL } pags_split;

/* Lists the views of the scene at `path`, named as their photographs. Fails if the split is empty. These functions'
 * `out` must be destroyed on failure, too. */
pags_result pags_viewpoints_of_scene(const pags_scene *scene, const char *path, pags_split split, pags_viewpoints *out);
/* Lists the views of a data set, named as their photographs. Fails if the split is empty. */
pags_result pags_viewpoints_of_dataset(const pags_dataset *dataset, pags_split split, pags_viewpoints *out);
/* Lists the frames of a path, named 00000, 00001, ...; copies the cameras. */
pags_result pags_viewpoints_of_path(const pags_camera_path *path, pags_viewpoints *out);
void pags_viewpoints_destroy(pags_viewpoints *viewpoints);

/* ---- pags render --shutter ---- */

/* Index of the option's choices; AS_RECORDED if not given: rolling if the camera has a rolling shutter. */
typedef enum pags_shutter_choice {
  PAGS_SHUTTER_AS_RECORDED = -1,
  PAGS_SHUTTER_GLOBAL,
  PAGS_SHUTTER_ROLLING
} pags_shutter_choice;

/* Sets the shutters of the cameras. ROLLING: if none of them has one, they get the readout of the scene's first view
 * with a rolling shutter, and their velocities along the path. PAGS_ERROR_ARGUMENT if there is no such view, or no time
 * between the cameras. */
pags_result pags_shutter_choose(pags_shutter_choice choice, const pags_scene *scene, pags_viewpoints *viewpoints);

#endif
