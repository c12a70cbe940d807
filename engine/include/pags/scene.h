/* SPDX-License-Identifier: Apache-2.0 */
/* A reconstructed scene: models of Gaussians, objects with tracks, views and a sky, as `pags train` writes them; and
 * bare splat files, which are read as a scene of one model.
 *
 * On disk a scene is a folder with scene.json and one PLY per model; see docs/scene-folder.md. */
#ifndef PAGS_SCENE_H
#define PAGS_SCENE_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/gaussians.h>
#include <pags/object.h>
#include <pags/photometric.h>
#include <pags/place.h>
#include <pags/sky.h>

PAGS_BEGIN_C

/* A set of Gaussians with its own PLY: the background, or the model of one object in the object's frame. */
typedef struct pags_model {
  char *name; /* the first model is "background" */
  char *file; /* path of its PLY relative to the scene folder; lies inside of the folder */
  pags_gaussians gaussians;
} pags_model;

/* A photograph that the scene was trained on or is tested with. */
typedef struct pags_scene_view {
  char *name;
  /* The time of `camera` is that of the frame (time step), at which the objects' boxes fit the photograph. */
  pags_camera camera;
  int test;   /* 1: held-out view */
  int sensor; /* number of the camera of the rig that took it; -1: unknown */
  int frame;  /* time step; -1: unknown */
  /* Exposure found in training, per channel: photograph = gain * picture + offset; 1 and 0 if unknown. The exposure of
   * a held-out view is interpolated in time between training views of the same sensor. */
  double gain[3];
  double offset[3];
  /* Pose correction found in training: rotation vector (radians) and translation (metres) in the recorded camera's
   * frame. `camera` includes it: camera = recorded * pags_increment_matrix(correction). Zeros: none. */
  double correction[6];
  union { /* vignetting and response of the camera, applied before the exposure; zeros: none */
    pags_photometric photometric;
    pags_photometric light; /* deprecated name */
  };
} pags_scene_view;

typedef struct pags_scene_object {
  pags_object record; /* box, class, track */
  int64_t model;      /* index of its own model; -1: its Gaussians lie in the background and carry object_id */
  int critical;       /* 1: its quality has priority */
  int rigid;          /* 1: rigid; 0: its parts also move against each other in its frame (means over time) */
} pags_scene_object;

/* The axes x, y, z of a splat file: a coordinate system as SPZ's record numbers them. The letters are the directions of
 * x, y and z: left or right, up or down, forward or back. PAGS' own, those of PLY files, are RDF. */
typedef enum pags_axes {
  PAGS_AXES_UNKNOWN,
  PAGS_AXES_LDB,
  PAGS_AXES_RDB,
  PAGS_AXES_LUB,
  PAGS_AXES_RUB,
  PAGS_AXES_LDF,
  PAGS_AXES_RDF,
  PAGS_AXES_LUF,
  PAGS_AXES_RUF,
  PAGS_AXES_LFD,
  PAGS_AXES_RFD,
  PAGS_AXES_LFU,
  PAGS_AXES_RFU,
  PAGS_AXES_LBD,
  PAGS_AXES_RBD,
  PAGS_AXES_LBU,
  PAGS_AXES_RBU,
  PAGS_AXES_COUNT
} pags_axes;

/* The name of axes, "RUB", a static string; "unknown" for 0 and numbers that aren't of pags_axes. */
PAGS_API const char *pags_axes_name(int axes);

/* The metadata of a splat file. */
typedef struct pags_splat_facts {
  const char *kind; /* "PLY", "compressed PLY", "splat", "SPZ v4", "SOG v2", "glTF", ...; static. NULL: no splat file */
  int antialiased;  /* 1: opacities expect the antialiased projection (Mip-Splatting) */
  pags_up up;       /* unknown unless stored in the file */
  double origin[3]; /* metres, to add to all positions; zeros unless stored in the file or positions are large */
  /* The part of `origin` that is not stored in the file. Positions of a PLY or SOG with more digits than a float has
   * are read relative to their median, in whole metres, if half of them lie beyond 4,096 m along an axis; those of a
   * glTF relative to its first node beyond 10,000 m. */
  double taken_off[3];
  int axes;              /* a pags_axes: the axes in which the file was read; unknown for formats without a choice */
  const char *axes_from; /* source of `axes`: "record", "specification", "option"; static; NULL if unknown */
  int64_t left_out;      /* number of Gaussians dropped because a value isn't finite */
  /* The alpha_min of the Gaussians before they were converted for programs that cut alpha at 1/255; 0: not converted.
   * Stored in files written by PAGS (.ply, .spz, .glb); reading reverses the conversion (docs/splat-files.md). */
  float converted_from;
} pags_splat_facts;

typedef struct pags_scene {
  pags_splat_facts file; /* if it was loaded from a bare splat file; otherwise zeros */
  double origin[3];      /* metres; world position = origin + float position */
  pags_up up;
  int antialiased;             /* 1: opacities expect the antialiased projection (Mip-Splatting; the flag in .spz) */
  float background[3];         /* background colour if there is no sky: display-referred sRGB, 0..1 */
  double time_begin, time_end; /* seconds; both 0 for a static scene */
  uint64_t seed;               /* seed of the training */
  char *dataset;               /* path of the data set that the scene was trained from; NULL if unknown */
  char *colmap;                /* folder of the COLMAP model given for its cameras; NULL: none */
  char *image_folder;          /* folder of its photographs if given separately; NULL: that of the data set */
  int image_alpha;             /* pags_image_alpha: use of their alpha channel */
  char *config;                /* the training configuration as JSON text; NULL if unknown */
  int64_t iterations;          /* training steps done; 0 if unknown */
  int64_t model_count;
  pags_model *models;
  int64_t view_count;
  pags_scene_view *views;
  double fps;       /* time steps per second of a driving scene; 0: unknown or static */
  pags_place place; /* geographic position of the recording's world, in which a point is origin + float position */
  int64_t object_count;
  pags_scene_object *objects; /* every labelled box, parked or moving; object_id of a Gaussian is an index here */
  pags_sky sky;               /* size 0: no sky */
  char *block; /* JSON text: the block of a recording that the scene was trained on (docs/blocks.md); NULL: none */
  char *notes; /* JSON text: what was modelled and why (docs/scene-folder.md, "modelled"); NULL: unknown */
} pags_scene;

/* Camera positions for a scene without photographs. */
typedef enum pags_stand {
  PAGS_STAND_AUTO,   /* inside if the Gaussians surround the middle of the scene, else around */
  PAGS_STAND_AROUND, /* outside, in a circle: an object */
  PAGS_STAND_INSIDE  /* inside: a room, a street */
} pags_stand;

/* Reads a scene folder (or its scene.json) or a bare splat file: .ply (INRIA's layout with the properties in any
 * order, or PlayCanvas compressed), .spz (versions 2 to 4), .sog or the meta.json of an unpacked one (versions 1 and
 * 2), .glb or .gltf with KHR_gaussian_splatting, .pagsz (packed) or .splat. The format is detected by the content,
 * except .splat, which has no signature, by the name. Metadata of the file (`scene->file`) is copied to the scene; a
 * splat file without an up axis gets -y.
 *
 * Also reads the output folder of INRIA's train.py: the newest point_cloud/iteration_N/point_cloud.ply, with
 * cameras.json as views and the background of cfg_args; and the folder of an unpacked SOG.
 *
 * An infinite opacity means 1 or 0, a scale of -inf a flat axis. Other Gaussians with a value that isn't finite are
 * dropped; a warning has their number and the first. A file without valid Gaussians is refused. All-zero quaternions
 * are replaced by the identity, with a warning. PAGS_ERROR_IO, PAGS_ERROR_FORMAT, PAGS_ERROR_LIMIT,
 * PAGS_ERROR_UNSUPPORTED (a newer version of a format) or PAGS_ERROR_MEMORY; then the scene is zeroed. */
PAGS_API pags_result pags_scene_load(const char *path, pags_scene *scene);

/* As pags_scene_load, but reads a bare splat file, or the one in a folder of another program, in `axes` (a pags_axes;
 * 0: as pags_scene_load) in place of those stored in it. PAGS_ERROR_ARGUMENT for scene folders, packed files and glTF,
 * whose axes are fixed. */
PAGS_API pags_result pags_scene_load_in_axes(const char *path, int axes, pags_scene *scene);

/* Returns the kind of a folder that pags_scene_load reads, a static string: "scene", "training output" or "SOG"; NULL
 * for other folders. */
PAGS_API const char *pags_scene_folder_kind(const char *path);

/* Writes the scene folder, which is created if missing. Each file is written under another name and then renamed;
 * scene.json is written last, so that a new scene.json only names files that exist. The folder is locked meanwhile.
 * PAGS_ERROR_IO (also if another process is writing there), PAGS_ERROR_MEMORY, PAGS_ERROR_ARGUMENT (a sky that float16
 * can't hold). */
PAGS_API pags_result pags_scene_save(const char *folder, const pags_scene *scene);

/* Frees everything that the scene owns and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_scene_destroy(pags_scene *scene);

/* Returns the number of Gaussians of all models together. */
PAGS_API int64_t pags_scene_gaussian_count(const pags_scene *scene);

/* Returns the labelled object whose track has this id, owned by the scene; NULL if not found. */
PAGS_API const pags_scene_object *pags_scene_find_object(const pags_scene *scene, const char *id);

/* Returns the camera of a view as the data set has it, without the correction. */
PAGS_API pags_camera pags_scene_view_recorded(const pags_scene_view *view);
/* Whether the view's pose was corrected. */
PAGS_API int pags_scene_view_is_corrected(const pags_scene_view *view);

/* Computes the exposure of a camera of the rig at a time (seconds), per channel of display-referred sRGB:
 * photograph = gain * picture + offset. The exposure is linear in time between training views of that sensor, and
 * constant before the first and after the last one. Gain 1 and offset 0 if that sensor has no training view. */
PAGS_API void pags_scene_exposure(const pags_scene *scene, int sensor, double time, double gain[3], double offset[3]);

/* Returns an unused relative file name "objects/NAME.ply" for the model of the object with the track id `id`.
 * NAME is the id with every character but letters, digits, '-' and '.' replaced by '_', at most 99 characters; a
 * number is appended if a model of the scene already has that file (case is ignored; models whose file is NULL
 * are skipped). The caller frees the string. NULL if out of memory. */
PAGS_API char *pags_scene_model_file(const pags_scene *scene, const char *id);

/* Read and write a single PLY of Gaussians (Kerbl et al. 2023), with s_sem, object_id and Fourier planes if it
 * has them. pags_ply_load also reads PlayCanvas's compressed PLY. Reading a file that pags_ply_save or INRIA's
 * trainer wrote and writing it again gives the same bytes; normals are not kept but written as zeros, as INRIA's
 * trainer does. A file appears complete or not at all. Errors as pags_scene_load; a failed load leaves `out`
 * empty. */
PAGS_API pags_result pags_ply_load(const char *path, pags_gaussians *out);
PAGS_API pags_result pags_ply_save(const char *path, const pags_gaussians *gaussians);

/* As pags_ply_save, with `facts` (NULL: none) as comments, which pags_splat_read reads: "SplatRenderMode: mip" if
 * antialiased, "Vertical axis: z" or "0 1 0" for y (-y is taken without), "offset X Y Z" for an origin that isn't 0. */
PAGS_API pags_result pags_ply_save_facts(const char *path, const pags_gaussians *gaussians,
                                         const pags_splat_facts *facts);

/* Returns the bytes per Gaussian in a file of pags_ply_save; the header takes less than 4 KiB. */
PAGS_API int pags_ply_row_bytes(const pags_gaussians *gaussians);

/* Reads a splat file of any of the formats of pags_scene_load and turns it to PLY's axes. `axes`: the axes of the file
 * (a pags_axes); 0: by format. SPZ has those of its coordinate-system record or, without one, RUB by its specification;
 * glTF those of glTF, but files written by PAGS are read in the axes of the scene; all others have PLY's. `path` may be
 * the folder of an unpacked SOG. `facts` may be NULL. Errors as pags_scene_load_in_axes. */
PAGS_API pags_result pags_splat_read(const char *path, int axes, pags_gaussians *out, pags_splat_facts *facts);

/* pags_splat_read with axes 0 and two of the facts, which may be NULL; positions are absolute. */
PAGS_API pags_result pags_splat_load(const char *path, pags_gaussians *out, const char **kind, int *antialiased);

PAGS_END_C
#endif
