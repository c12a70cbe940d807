/* SPDX-License-Identifier: Apache-2.0 */
/* Builds a glTF 2.0 file in memory: meshes, points, cameras, nodes, one animation. The first failure is kept and
 * returned by pags_gltf_save; calls after a failure do nothing. gltf_cameras.c adds what a scene has: its views, the
 * tracks of its objects and of the ego vehicle. */
#ifndef PAGS_FORMAT_GLTF_H
#define PAGS_FORMAT_GLTF_H

#include <pags/scene.h>

#include "base/json.h"
#include "exporters/proxy/texture.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_gltf pags_gltf;

pags_result pags_gltf_create(pags_gltf **out);
void pags_gltf_destroy(pags_gltf *gltf); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_gltf, pags_gltf_destroy)

/* The functions that return int add one item and return its glTF index, or -1 after a failure. Names are copied; a
 * number is appended to a name that another thing of its kind has, and what has none is "unnamed". */
/* `atlas` NULL or empty: vertices have the colour. A file has one atlas at most. */
int pags_gltf_material(pags_gltf *gltf, const char *name, bool double_sided, const pags_atlas *atlas);
enum { PAGS_GLTF_NORMALS = 1, PAGS_GLTF_MANIFOLD = 2, PAGS_GLTF_BARE = 4 };
/* Adds a triangle mesh with POSITION and COLOR_0 (linear light, 16 bits a channel), or with a texture that is in an
 * atlas TEXCOORD_0 and a vertex for each chart that a vertex is in. PAGS_GLTF_NORMALS adds smooth vertex normals
 * (without normals, readers shade flat); PAGS_GLTF_MANIFOLD adds EXT_mesh_manifold (the mesh must be closed);
 * PAGS_GLTF_BARE leaves out colours. `texture` may be NULL or empty. */
int pags_gltf_mesh(pags_gltf *gltf, const char *name, const pags_proxy_mesh *surface, const pags_texture *texture,
                   int material, int flags);
/* Adds a node. `parent`: a node's index; -1: a root of the scene; -2: outside of the scene (coarser levels of detail,
 * which only MSFT_lod names). */
int pags_gltf_node(pags_gltf *gltf, int parent, const char *name);
int pags_gltf_camera(pags_gltf *gltf, const char *name, const pags_camera *camera);

void pags_gltf_node_pose(pags_gltf *gltf, int node, const double pose[12]);
/* Sets the pose of the root node, which turns the scene to glTF's Y up: z-up worlds by -90 degrees about x, worlds
 * whose y points down, or of whom nothing is known, by 180 degrees. */
void pags_gltf_node_up(pags_gltf *gltf, int node, pags_up up);
void pags_gltf_node_mesh(pags_gltf *gltf, int node, int mesh);
void pags_gltf_node_camera(pags_gltf *gltf, int node, int camera);
/* Sets `extras` of a node, or for -1 of the asset, to the JSON object in the text `json`, or to the object open in `w`,
 * which it ends. PAGS_ERROR_MEMORY. */
void pags_gltf_extras(pags_gltf *gltf, int node, const char *json);
pags_result pags_gltf_put_extras(pags_gltf *gltf, int node, pags_json_writer *w);
/* Sets an extension of a node, or for -1 of the whole file, to the JSON text `json`. The extension is listed in
 * extensionsUsed, never in extensionsRequired. */
void pags_gltf_extension(pags_gltf *gltf, int node, const char *name, const char *json);

/* Animates a node's translation and rotation: `count` rigid poses (3x4, row-major) at `times` (seconds, ascending,
 * from 0), interpolated linearly. The tracks of all nodes are channels of one animation. */
void pags_gltf_node_track(pags_gltf *gltf, int node, int64_t count, const double *times, const double (*poses)[12]);

/* One vertex attribute of pags_gltf_points, which adds `count` points (primitive mode POINTS) whose primitive carries
 * `extension` with the JSON text `extension_json`. splat_files.c writes KHR_gaussian_splatting with it. */
typedef struct pags_gltf_attribute {
  const char *name;
  int components; /* 1, 3 or 4 */
  const float *values;
} pags_gltf_attribute;
int pags_gltf_points(pags_gltf *gltf, const char *name, int64_t count, const pags_gltf_attribute *attributes,
                     int attribute_count, const char *extension, const char *extension_json);

/* Gives a node the pose of an object relative to the scene's origin, and a moving object's track as animation.
 * `time_zero` here and below is the scene's time, in seconds, that is 0 in the file. */
pags_result pags_gltf_node_place(pags_gltf *gltf, int node, const pags_scene *scene, const pags_object *object,
                                 double time_zero);

/* Adds two nodes below `parent`: `cameras`, with a camera node for every view (held-out views, too), and `ego`, the ego
 * vehicle, animated with the poses of the camera with the lowest number, turned to x forward, y left, z up. Positions
 * below `parent` are those of the scene relative to its origin. */
pags_result pags_gltf_add_views(pags_gltf *gltf, int parent, const pags_scene *scene, double time_zero);

/* Writes a .glb or, for a path that ends in .gltf, that file and its .bin in the same folder. To be called once, last:
 * it empties the buffer. */
pags_result pags_gltf_save(pags_gltf *gltf, const char *path);

#ifdef __cplusplus
}
#endif
#endif
