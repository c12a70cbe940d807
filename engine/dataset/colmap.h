/* SPDX-License-Identifier: Apache-2.0 */
/* COLMAP models: finding one below a folder (colmap_models.c), and what colmap.c and the readers of the two file
 * formats share: binary (colmap_bin.c) and text (colmap_txt.c). */
#ifndef PAGS_DATASET_COLMAP_H
#define PAGS_DATASET_COLMAP_H

#include "dataset/parsed.h"

/* Finds a model below `root`: in root itself, sparse/N, sparse, colmap/sparse/N or colmap/sparse, else in the first
 * folder that has one, at most 4 levels down. The mapper writes a model for each set of pictures that it could connect,
 * so that one is often a fragment: of several with the same parent it is the one with most pictures; the others are
 * named in the log, as are data sets that lie next to that folder. *out is its folder, freed by the caller; NULL if not
 * found. */
pags_result pags_colmap_find_model(const char *root, char **out);

/* Warns of pictures that lie next to those of the views but are not views. */
pags_result pags_count_unused_pictures(const pags_parsed_dataset *parsed);

typedef struct pags_colmap_camera {
  int64_t id;
  pags_lens lens;
  /* Why it can't be used, an error as soon as an image has it; NULL: nothing. Freed by colmap.c. */
  char *problem;
  bool unsupported; /* the problem is PAGS_ERROR_UNSUPPORTED */
} pags_colmap_camera;

typedef struct pags_colmap {
  pags_parsed_dataset *parsed;
  int64_t camera_count, camera_capacity;
  pags_colmap_camera *cameras; /* sorted by id after the cameras file was read */
} pags_colmap;

typedef struct pags_colmap_image {
  int64_t id, camera;
  double pose[7]; /* camera_from_world: quaternion w x y z, translation */
  const char *name;
} pags_colmap_image;

typedef struct pags_colmap_bytes {
  const char *path;
  uint8_t *data; /* content of the file, followed by a zero byte */
  size_t size;
} pags_colmap_bytes;

typedef pags_result pags_colmap_read_fn(pags_colmap *model, const pags_colmap_bytes *bytes);

pags_colmap_read_fn pags_colmap_cameras_bin, pags_colmap_images_bin, pags_colmap_points_bin;
pags_colmap_read_fn pags_colmap_cameras_txt, pags_colmap_images_txt, pags_colmap_points_txt;

/* Finds a camera model by its name or, if that is NULL, by COLMAP's numeric id. PAGS_ERROR_UNSUPPORTED if it isn't
 * known. */
pags_result pags_colmap_find_kind(const char *where, const char *name, int64_t id, int *kind);
enum { PAGS_COLMAP_PARAMETERS = 16 };
int pags_colmap_parameters(int kind); /* number of parameters of the camera model, at most PAGS_COLMAP_PARAMETERS */
void pags_colmap_set_lens(int kind, const double *parameters, pags_lens *lens);

/* Keeps the error that was just set as the problem of the last camera, so that an unused camera refuses nothing. */
pags_result pags_colmap_keep_problem(pags_colmap *model, pags_result result);
pags_colmap_camera *pags_colmap_add_camera(pags_colmap *model); /* zeroed; NULL when out of memory */
pags_result pags_colmap_sort_cameras(pags_colmap *model, const char *where);
pags_result pags_colmap_add_image(pags_colmap *model, const char *where, const pags_colmap_image *image);

#endif
