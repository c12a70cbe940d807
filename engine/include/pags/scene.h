/* SPDX-License-Identifier: Apache-2.0 */
/* A reconstructed scene: what `pags train` writes, and what a bare splat file is read as.
 *
 * On disk a scene is a folder with scene.json and one PLY per model; see docs/scene-folder.md. */
#ifndef PAGS_SCENE_H
#define PAGS_SCENE_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/gaussians.h>
#include <pags/object.h>
#include <pags/place.h>
#include <pags/sky.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_model {
  char *name; /* "background" first */
  char *file; /* relative path of its PLY in the scene folder */
  pags_gaussians gaussians;
} pags_model;

typedef struct pags_scene_view { /* a photograph the scene was trained on or tested with */
  char *name;
  pags_camera camera; /* its time is that of the frame: boxes of the frame fit the photograph as they stand */
  int test;
  int sensor;       /* which camera of the rig took it; -1: unknown */
  int frame;        /* time step; -1: unknown */
  double gain[3];   /* exposure found in training, per channel: photograph = gain * picture + offset; 1 */
  double offset[3]; /* 0. Held-out views: interpolated in time between training views of the same sensor */
} pags_scene_view;

typedef struct pags_scene_object {
  pags_object record; /* box, class, track */
  int64_t model;      /* index of its own model; -1: its Gaussians lie in the background and carry object_id */
  int critical;
  int rigid; /* 0: moves within its frame, too (means over time); 1 else */
} pags_scene_object;

typedef struct pags_scene {
  double origin[3]; /* metres; added to every float position */
  pags_up up;
  int antialiased;             /* 1: opacities expect the antialiased projection (Mip-Splatting, spz flag) */
  float background[3];         /* display-referred sRGB behind everything, 0..1 */
  double time_begin, time_end; /* seconds; both 0 for a static scene */
  uint64_t seed;
  char *dataset;      /* path the scene was trained from, NULL if unknown */
  char *config;       /* JSON text of the training configuration, NULL if unknown */
  int64_t iterations; /* steps done, 0 if unknown */
  int64_t model_count;
  pags_model *models;
  int64_t view_count;
  pags_scene_view *views;
  double fps;       /* time steps per second of a driving scene; 0: unknown or static */
  pags_place place; /* of the recording's world: `origin` has to be added to float positions first */
  int64_t object_count;
  pags_scene_object *objects; /* every labelled box, parked or moving; Gaussians' object_id is the index here */
  pags_sky sky;               /* size 0: none */
  char *notes; /* JSON text: what was modelled and why (see docs/scene-folder.md, "modelled"); NULL: nothing is known */
} pags_scene;

/* Reads a scene folder or a bare splat file: .ply (INRIA layout in any property order, or PlayCanvas compressed),
 * .splat, .spz (v2-v4), chosen by content. Gaussians that can't be drawn (non-finite values) are an error naming the
 * first; all-zero quaternions become the identity and are counted in a log line. The scene is zeroed on failure. */
PAGS_API pags_result pags_scene_load(const char *path, pags_scene *scene);

/* Writes the folder, made if missing. Each file is written beside and renamed. */
PAGS_API pags_result pags_scene_save(const char *folder, const pags_scene *scene);
PAGS_API void pags_scene_destroy(pags_scene *scene);
PAGS_API int64_t pags_scene_gaussian_count(const pags_scene *scene);
/* The labelled object whose track has this id, owned by the scene; NULL: there is none. */
PAGS_API const pags_scene_object *pags_scene_find_object(const pags_scene *scene, const char *id);

/* How a camera of the rig exposes at a time (seconds), display-referred sRGB per channel: photograph = gain * picture +
 * offset. Between training views of that sensor linear in time, beyond them as at the last one; 1 and 0 where the scene
 * has none. */
PAGS_API void pags_scene_exposure(const pags_scene *scene, int sensor, double time, double gain[3], double offset[3]);

/* "objects/NAME.ply" for the model of the object `id`: letters, digits, '-' and '.' stay, the rest becomes '_'; a
 * number is added where a model of the scene has that file already (case ignored). Models whose file is NULL are passed
 * over. Freed by the caller; NULL when memory is out. */
PAGS_API char *pags_scene_model_file(const pags_scene *scene, const char *id);

/* Splat files by themselves. Reading a file that pags_ply_save or INRIA's trainer wrote and writing it again gives the
 * same bytes; normals are kept as zeros. */
PAGS_API pags_result pags_ply_load(const char *path, pags_gaussians *out);
PAGS_API pags_result pags_ply_save(const char *path, const pags_gaussians *gaussians);
/* What each of its Gaussians takes in such a file, bytes; the header takes less than 4 KiB. */
PAGS_API int pags_ply_row_bytes(const pags_gaussians *gaussians);
/* `kind` receives a static string ("PLY", "compressed PLY", "splat", "SPZ v4"); antialiased 1 if the file says so. Both
 * may be NULL. */
PAGS_API pags_result pags_splat_load(const char *path, pags_gaussians *out, const char **kind, int *antialiased);

#ifdef __cplusplus
}
#endif
#endif
