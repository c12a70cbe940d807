/* SPDX-License-Identifier: Apache-2.0 */
/* Reads meshes from GLB files (glTF 2.0 binary) as pags export writes them, with one buffer, for pags-bench
 * proxies. */
#ifndef PAGS_BENCHMARKS_GLB_H
#define PAGS_BENCHMARKS_GLB_H

#include "base/json.h"
#include "exporters/proxy/mesh.h"

typedef struct pags_glb {
  uint8_t *bytes;
  const uint8_t *buffer;
  size_t size, buffer_size;
  pags_json *json;
  const pags_json_value *root;
} pags_glb;

pags_result pags_glb_open(const char *path, pags_glb *out);
void pags_glb_close(pags_glb *file);

/* Look up a member of a JSON object; return NULL or `fallback` if it is missing. `object` may be NULL. */
const pags_json_value *pags_glb_member(const pags_json_value *object, const char *key);
int64_t pags_glb_integer(const pags_json_value *object, const char *key, int64_t fallback);

/* The text of a member; NULL if it is missing or no text. */
const char *pags_glb_text(const pags_json_value *object, const char *key);
/* An element of one of the file's lists ("nodes", "meshes", ...); NULL beyond the last. */
const pags_json_value *pags_glb_element(const pags_glb *file, const char *list, int64_t index);
/* The pose of a node in its parent, from translation, rotation and scale. */
void pags_glb_pose(const pags_json_value *node, double pose[12]);

/* Reads positions and triangles of a mesh's first primitive. */
pags_result pags_glb_mesh(const pags_glb *file, int64_t mesh, pags_proxy_mesh *out);

#endif
