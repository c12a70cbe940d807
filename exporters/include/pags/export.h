/* SPDX-License-Identifier: Apache-2.0 */
/* Export of a reconstructed scene to other programs: as proxy meshes (glTF), as files of Gaussians, or as a USD stage
 * with both.
 *
 * A proxy is a mesh that approximates the surface of Gaussians. The proxy of a labelled object is in the object's own
 * frame (x forward, y left, z up, origin at the middle of the labelled box); the proxies of the ground and of the
 * rest of the background are in the scene's frame, relative to its origin.
 *
 * Proxies are made of what training views see. A scene without any, such as a bare splat file, is looked at from views
 * made up all round it, or within it if it is a room; all of it becomes one proxy `surface_000`, closed and of the
 * level asked for, or, of a room, chunks of this name. */
#ifndef PAGS_EXPORT_H
#define PAGS_EXPORT_H

#include <pags/base.h>
#include <pags/scene.h>
#include <pags/tasks.h>

PAGS_BEGIN_C

typedef enum pags_proxy_level {
  PAGS_PROXY_MESH,   /* the closed surface of the Gaussians, decimated to a limit of triangles */
  PAGS_PROXY_CAGE,   /* a closed cage of quads, subdivided, whose Catmull-Clark limit surface is fitted to that mesh */
  PAGS_PROXY_HULL,   /* the convex hull of that mesh */
  PAGS_PROXY_BOX,    /* the labelled box */
  PAGS_PROXY_CONVEX, /* up to 8 convex parts that together cover the mesh, each of at most 124 triangles */
  PAGS_PROXY_LEVELS
} pags_proxy_level;

/* The level's name: "mesh", "cage", "hull", "box" or "convex", a static string. */
PAGS_API const char *pags_proxy_level_name(pags_proxy_level level);

/* In glTF. With the names of a program, a hull, a box or convex parts are added to the object's surface, which
 * is the visible mesh; not with `lod`. */
typedef enum pags_proxy_naming {
  PAGS_NAMING_PLAIN,  /* proxies are named by class and number: car_0007 */
  PAGS_NAMING_UNREAL, /* hulls are UCX_car_0007_00, boxes UBX_car_0007_00: Unreal's importer makes collision shapes of
                        meshes with these prefixes for the mesh that the rest names, car_0007 */
  PAGS_NAMING_GODOT   /* surfaces are car_0007_mesh-col, hulls car_0007_00-convcolonly: Godot's importer makes collision
                        shapes of nodes with these endings */
} pags_proxy_naming;

/* The form of the background's proxies besides the ground. */
typedef enum pags_background_form {
  PAGS_BACKGROUND_BLOCKS, /* buildings and walls are closed blocks that reach the ground. For worlds with z up that have
                             photographs; others get their surface */
  PAGS_BACKGROUND_SURFACE /* chunks of the surface, open where nothing was seen */
} pags_background_form;

typedef struct pags_proxy_options {
  pags_proxy_level level;
  const uint8_t *chosen; /* a flag for each of the scene's objects: 1 is exported; NULL: all are */
  int lod;               /* 1: mesh, cage, hull and box go into one file by MSFT_lod, finest first. Default 0 */
  pags_proxy_naming naming;
  int64_t triangles;        /* limit of triangles of an object's mesh, cage, hull or convex parts, 12..10^7; default
                               4000 */
  int64_t ground_triangles; /* limit of triangles of the ground, 2..10^8; default 60,000 */
  int64_t chunk_triangles;  /* limit of triangles of the other background, all chunks together; default 200,000 */
  double voxel; /* step of the background's TSDF, metres, up to 2; default 0: 0.15. An object's step is a 128th of its
                   length, at least 2 cm. In a scene without photographs: a 192nd of the longest side of what is
                   there, of a room a 400th */
  double chunk; /* side of the background's chunks, metres; default 0: 20, of a room without photographs a quarter
                   of its longest side */
  double range; /* rendered depths beyond it are not used for the background, metres; default 0: 60, of a room
                   without photographs a third of its longest side */
  const double *box;  /* 6 numbers, lowest x, y, z and highest, or NULL: triangles of ground and chunks whose middle is
                         outside are left out; metres relative to the scene's origin. Gaussians outside are for the
                         caller to leave out */
  const double *ball; /* 4 numbers, middle and radius, or NULL: likewise */
  pags_stand stand;   /* from where a scene without photographs is looked at; default PAGS_STAND_AUTO */
  int texture;    /* pixels a side, 64..8192: glTF's meshes, cages and chunks share a picture of at most this size, in
                     place of a colour at each vertex; default 0: no */
  int cage_level; /* Catmull-Clark subdivisions of the cage as written, 0 (the cage itself) to 3; default 1 */
  int collision;  /* 1: for glTF that physics alone reads: no colours, the ground as a slab, and nothing that is open.
                     With names for Godot there are collision shapes without visible meshes. Default 0 */
  int background; /* 1: the ground and the chunks are exported, too. Default 1 */
  pags_background_form background_form; /* default PAGS_BACKGROUND_BLOCKS */
  const char *ground_file; /* a .ply file to write the ground's mesh to, without colours, for physics; NULL: none */
  int cameras;             /* 1: all views are written as cameras, the first sensor's path as a node `ego`. Default 0 */
  int visibility;          /* 1: KHR_node_visibility makes proxies invisible (colliders only). Default 0 */
  int physics; /* 1: objects are kinematic bodies by KHR_implicit_shapes and KHR_physics_rigid_bodies. Default 0 */
} pags_proxy_options;

PAGS_API pags_proxy_options pags_proxy_options_default(void);

typedef struct pags_proxy_distance {
  double mean, p95, max; /* mean, 95th percentile, largest, in metres; NaN if there was nothing to measure */
} pags_proxy_distance;

/* The facts and the measured error of one proxy, as reported on the terminal, in glTF extras and in JSON. */
typedef struct pags_proxy_facts {
  const char *name;
  const char *class_name; /* "Car", "ground", "building", ... */
  pags_proxy_level level; /* the level made, which may not be the one asked for: hardly seen objects become boxes */
  int64_t object;         /* index of the object in the scene; -1: background */
  int critical, moving;
  int64_t gaussians; /* number of Gaussians that the proxy is of */
  double s_sem;      /* mean semantic priority of those Gaussians; NaN if unknown */
  int64_t vertices, triangles;
  int closed;      /* watertight: every edge has two faces that run along it in opposite directions, and the volume is
                      positive */
  double volume;   /* cubic metres; 0 if the mesh is not closed */
  double observed; /* share of the surface that some training camera saw; the rest is completed: docs/proxies.md */
  double unseen_depth; /* of a block of the background: how far it reaches behind the surface that was seen, metres; 0:
                          not a block */
  pags_proxy_distance to_gaussians;   /* from the proxy's seen surface to the Gaussians' surface (rendered depth) */
  pags_proxy_distance from_gaussians; /* from the Gaussians' surface to the proxy */
  double silhouette_iou; /* intersection over union of the silhouettes of proxy and Gaussians, over the sampled pixels
                            of all views together; NaN: not measured */
  int silhouette_views;
  const char *note; /* why the proxy is not what was asked for; NULL: it is */
} pags_proxy_facts;

typedef struct pags_proxy_report {
  int64_t count;
  pags_proxy_facts *proxies;
} pags_proxy_report;

PAGS_API void pags_proxy_report_destroy(pags_proxy_report *report);

/* Writes a proxy's facts as members of the JSON object that the writer is in, as they are in glTF extras. */
struct pags_json_writer;
PAGS_API void pags_proxy_facts_put(struct pags_json_writer *writer, const pags_proxy_facts *facts);

/* Makes the scene's proxies and writes them to `path`, .glb or .gltf (with its .bin in the same folder). `report` (may
 * be NULL) receives each proxy's facts. The bytes are the same for any number of threads. */
PAGS_API pags_result pags_export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                         pags_tasks *tasks, pags_progress_fn *progress, void *user,
                                         pags_proxy_report *report);

typedef struct pags_splat_options {
  double time;     /* seconds of the scene's clock: objects get their poses at this time; NaN: the scene's begin */
  int sh_degree;   /* highest degree of spherical harmonics that is written, 0..3; default 3 */
  int tracks;      /* 1: glTF files get a node for each object, in its own frame, animated by its track. Default 0 */
  int spz_version; /* 3 (gzip, default) or 4 (zstd) */
  int spz_axes;    /* a pags_axes, 1..8: the axes of .spz files, which a record in them names. Default RUB, as SPZ's
                      specification says; RDF for programs that take SPZ to have PLY's axes (splat-transform, SuperSplat)
                    */
} pags_splat_options;

PAGS_API pags_splat_options pags_splat_options_default(void);

/* Whether the path's extension, in any case, is that of a format that holds only Gaussians: .ply, .spz, .sog, .splat
 * or .pagsz; or the path's file is meta.json, that of a SOG in a folder. */
PAGS_API int pags_export_is_splat(const char *path);

/* Writes all Gaussians of the scene as they are at a time, each object at its pose, its harmonics rotated with it.
 * The extension chooses the format: .ply (INRIA's), .spz, .sog or FOLDER/meta.json (SOG version 2), .splat (no
 * harmonics), .pagsz (pags/packed.h; with s_sem if all parts have it, without the sky), or .glb and .gltf with
 * KHR_gaussian_splatting. Positions are relative to the scene's origin. The origin, the up axis and whether the
 * Gaussians are antialiased are comments of a .ply, a record of a .spz, in the meta.json of a SOG, extras of a glTF's
 * asset and in the head of a .pagsz; what a .splat can't hold, and what is beyond the range of a .spz, goes to the log
 * as warnings. Takes over the scene's Gaussians (`scene` is zeroed). `count` (may be NULL)
 * receives the number of Gaussians written. */
PAGS_API pags_result pags_export_splats(pags_scene *scene, const char *path, const pags_splat_options *options,
                                        int64_t *count);

/* Writes the Gaussians and the proxies as a USD stage in text (.usda, or .usdz, an archive of it), Z up, in metres.
 * Gaussians are ParticleField3DGaussianSplat prims, each object's below an Xform with its track as time samples;
 * proxies are invisible meshes with UsdPhysics colliders and semantic labels; objects are kinematic bodies. Harmonics
 * are written of degree 0 if splats->sh_degree or the scene's degree is 0, else of degree 3 with missing terms zero.
 * The scene is destroyed, as by pags_export_splats. `count` (may be NULL) receives the number of Gaussians written. */
PAGS_API pags_result pags_export_usd(pags_scene *scene, const char *path, const pags_proxy_options *proxies,
                                     const pags_splat_options *splats, pags_tasks *tasks, pags_progress_fn *progress,
                                     void *user, int64_t *count);

PAGS_END_C
#endif
