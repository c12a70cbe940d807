/* SPDX-License-Identifier: Apache-2.0 */
/* The cameras that a verb draws, each with the name of its picture. */
#ifndef PAGS_CLI_VIEWPOINTS_H
#define PAGS_CLI_VIEWPOINTS_H

#include <pags/dataset.h>
#include <pags/scene.h>

typedef struct pags_viewpoint {
  char *name; /* of the picture, without folder and extension */
  pags_camera camera;
  double gain[3], offset[3]; /* exposure of what took it; 1 and 0 where that is not known */
} pags_viewpoint;

typedef struct pags_viewpoints {
  int64_t count;
  pags_viewpoint *items;
} pags_viewpoints;

typedef enum pags_split { PAGS_SPLIT_TRAIN, PAGS_SPLIT_TEST, PAGS_SPLIT_ALL } pags_split;

/* The scene's own views, named as their photographs. An error when the split is empty. */
pags_result pags_viewpoints_of_scene(const pags_scene *scene, pags_split split, pags_viewpoints *out);
/* The views of a data set. */
pags_result pags_viewpoints_of_dataset(const pags_dataset *dataset, pags_split split, pags_viewpoints *out);
/* Frames of a path, named 00000, 00001, ...; takes the cameras out of `path`. */
pags_result pags_viewpoints_of_path(const pags_camera_path *path, pags_viewpoints *out);
void pags_viewpoints_destroy(pags_viewpoints *viewpoints);

#endif
