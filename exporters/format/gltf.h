/* SPDX-License-Identifier: Apache-2.0 */
/* Building a glTF 2.0 file. The first failure is remembered and reported by save; what comes after it does nothing. */
#ifndef PAGS_FORMAT_GLTF_H
#define PAGS_FORMAT_GLTF_H

#include <pags/camera.h>

#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_gltf pags_gltf;

pags_result pags_gltf_create(pags_gltf **out);
void pags_gltf_destroy(pags_gltf *gltf); /* NULL is allowed */

/* All return an index, -1 after a failure. Names are copied. */
int pags_gltf_material(pags_gltf *gltf, const char *name, int double_sided);
enum { PAGS_GLTF_NORMALS = 1, PAGS_GLTF_MANIFOLD = 2 };
/* Positions, COLOR_0 (linear, 16 bits), smooth normals by flag (else readers shade flat), EXT_mesh_manifold by flag
 * (the surface must be closed). */
int pags_gltf_mesh(pags_gltf *gltf, const char *name, const pags_proxy_mesh *surface, int material, int flags);
/* parent -1: a root of the scene; -2: in no scene (levels of detail). */
int pags_gltf_node(pags_gltf *gltf, int parent, const char *name);
int pags_gltf_camera(pags_gltf *gltf, const char *name, const pags_camera *camera);

void pags_gltf_node_pose(pags_gltf *gltf, int node, const double pose[12]);
void pags_gltf_node_mesh(pags_gltf *gltf, int node, int mesh);
void pags_gltf_node_camera(pags_gltf *gltf, int node, int camera);
/* JSON text of an object. */
void pags_gltf_node_extras(pags_gltf *gltf, int node, const char *json);
void pags_gltf_asset_extras(pags_gltf *gltf, const char *json);
/* JSON text; the extension is named in extensionsUsed, never in extensionsRequired. */
void pags_gltf_node_extension(pags_gltf *gltf, int node, const char *name, const char *json);
void pags_gltf_extension(pags_gltf *gltf, const char *name, const char *json);

/* Translation and rotation at `times` (seconds, ascending, from 0 on), linear between; all nodes share one animation.
 */
void pags_gltf_node_track(pags_gltf *gltf, int node, int64_t count, const double *times, const double (*poses)[12]);

/* Attributes of points (mode POINTS), for splats: see splat_files.c. */
typedef struct pags_gltf_attribute {
  const char *name;
  int components; /* 1, 3 or 4 */
  const float *values;
} pags_gltf_attribute;
int pags_gltf_points(pags_gltf *gltf, const char *name, int64_t count, const pags_gltf_attribute *attributes,
                     int attribute_count, const char *extension, const char *extension_json);

/* .glb, or .gltf with its .bin beside it. */
pags_result pags_gltf_save(pags_gltf *gltf, const char *path);

#ifdef __cplusplus
}
#endif
#endif
