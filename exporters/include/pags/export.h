/* SPDX-License-Identifier: Apache-2.0 */
/* Proxy geometry of a reconstructed scene, and splat files to leave with.
 *
 * A proxy is a mesh that stands for what the Gaussians show: of each labelled object in the object's own frame (x
 * forward, y left, z up, origin at the middle of the box), of the ground and of the rest of the background in the
 * scene's frame (relative to its origin). */
#ifndef PAGS_EXPORT_H
#define PAGS_EXPORT_H

#include <pags/base.h>
#include <pags/scene.h>
#include <pags/tasks.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_proxy_level {
  PAGS_PROXY_MESH, /* the surface of the Gaussians, closed, decimated to a budget of triangles */
  PAGS_PROXY_CAGE, /* a closed quad cage fitted to it, subdivided */
  PAGS_PROXY_HULL, /* its convex hull */
  PAGS_PROXY_BOX,  /* the labelled box */
  PAGS_PROXY_LEVELS
} pags_proxy_level;

/* "mesh", "cage", "hull", "box"; static. */
PAGS_API const char *pags_proxy_level_name(pags_proxy_level level);

typedef enum pags_proxy_naming {
  PAGS_NAMING_PLAIN, /* car_0007 */
  PAGS_NAMING_UNREAL /* hulls are UCX_car_0007_00, boxes UBX_car_0007: what Unreal's importer makes collision shapes of
                      */
} pags_proxy_naming;

typedef struct pags_proxy_options {
  pags_proxy_level level;
  const uint8_t *chosen; /* one a scene's object: 1 is exported; NULL: all */
  int lod;               /* 1: all levels in one file by MSFT_lod, finest first. Default 0 */
  pags_proxy_naming naming;
  int64_t triangles;        /* most triangles of an object's mesh or hull, 12..10^7; default 4000 */
  int64_t ground_triangles; /* most of the ground, 2..10^8; default 60,000 */
  int64_t chunk_triangles;  /* most of the rest of the background, all chunks together; default 200,000 */
  double voxel; /* of the background, metres, 0.02..2; default 0.15. Objects: a 128th of their length, at least 2 cm */
  double chunk; /* side of the background's chunks, metres, 2..1000; default 20 */
  double range; /* depths beyond it are left out of the background, metres; default 60 */
  int cage_level; /* subdivisions of the cage as written, 0 (the cage itself) to 3; default 1 */
  int background; /* 1: ground and chunks, too. Default 1 */
  int cameras;    /* 1: the training views as cameras, and the way of the first of them as a node `ego`. Default 0 */
  int visibility; /* 1: KHR_node_visibility, proxies invisible (colliders only). Default 0 */
  int physics;    /* 1: KHR_implicit_shapes and KHR_physics_rigid_bodies, kinematic bodies. Default 0 */
} pags_proxy_options;

PAGS_API pags_proxy_options pags_proxy_options_default(void);

typedef struct pags_proxy_distance {
  double mean, p95, max; /* metres; NaN where there was nothing to measure */
} pags_proxy_distance;

/* What is said of every proxy, on the terminal, in extras and in JSON. */
typedef struct pags_proxy_facts {
  const char *name;
  const char *class_name; /* "Car", "ground", "building", ... */
  pags_proxy_level level; /* as made; objects too small or too little seen become boxes */
  int64_t object;         /* index in the scene; -1: background */
  int critical, moving;
  int64_t gaussians;
  double s_sem; /* mean; NaN where unknown */
  int64_t vertices, triangles;
  int closed;      /* every edge has two faces, opposite ways, and the volume is positive */
  double volume;   /* cubic metres; 0 where it is not closed */
  double observed; /* share of the surface that some training camera saw; the rest is completed: docs/proxies.md */
  pags_proxy_distance to_gaussians;   /* from the proxy's seen surface to the Gaussians' surface (rendered depth) */
  pags_proxy_distance from_gaussians; /* the other way */
  double silhouette_iou;              /* over the training cameras, all pixels together; NaN: not measured */
  int silhouette_views;
  const char *note; /* why it is not what was asked for; NULL: it is */
} pags_proxy_facts;

typedef struct pags_proxy_report {
  int64_t count;
  pags_proxy_facts *proxies;
} pags_proxy_report;

PAGS_API void pags_proxy_report_destroy(pags_proxy_report *report);

/* The members of a JSON object that say what extras say. */
struct pags_json_writer;
PAGS_API void pags_proxy_facts_put(struct pags_json_writer *writer, const pags_proxy_facts *facts);

/* Writes `path`, .glb or .gltf (with its .bin beside it). `report` may be NULL. Same bytes for any number of threads.
 */
PAGS_API pags_result pags_export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                         pags_tasks *tasks, pags_progress_fn *progress, void *user,
                                         pags_proxy_report *report);

typedef struct pags_splat_options {
  double time;   /* seconds of the scene's clock at which objects are put where they are; NaN: its begin */
  int sh_degree; /* higher terms are cut, 0..3; default 3 */
  int tracks;    /* 1: of glTF files, a node for each object in its own frame, with its track as animation. Default 0 */
  int spz_version; /* 3 (gzip, default) or 4 (zstd) */
} pags_splat_options;

PAGS_API pags_splat_options pags_splat_options_default(void);

/* Whether the file's extension is one of splats alone: .ply, .spz, .splat, .pagsz. */
PAGS_API int pags_export_is_splat(const char *path);

/* The whole scene as it is at a time, objects in their places, their harmonics turned with them: .ply (INRIA's), .spz,
 * .splat (no harmonics), .pagsz (pags/packed.h; with s_sem where all parts have it, without the sky), or .glb and .gltf
 * with KHR_gaussian_splatting. Positions are relative to the scene's origin. Takes the scene's Gaussians
 * (`scene` is zeroed). `count` (may be NULL) receives how many were written. */
PAGS_API pags_result pags_export_splats(pags_scene *scene, const char *path, const pags_splat_options *options,
                                        int64_t *count);

/* A USD stage in text (.usda): Z up, metres; Gaussians as ParticleField3DGaussianSplat, each object's below an Xform
 * with its track as time samples, and the proxies as invisible meshes with UsdPhysics' colliders, objects as kinematic
 * bodies, with semantic labels. Of harmonics the constant alone where options->sh_degree or the scene's is 0, else all
 * up to degree 3, missing ones zero. Takes the scene as pags_export_splats does. `count` (may be NULL) receives how
 * many Gaussians were written. */
PAGS_API pags_result pags_export_usd(pags_scene *scene, const char *path, const pags_proxy_options *proxies,
                                     const pags_splat_options *splats, pags_tasks *tasks, pags_progress_fn *progress,
                                     void *user, int64_t *count);

#ifdef __cplusplus
}
#endif
#endif
