/* SPDX-License-Identifier: Apache-2.0 */
/* Writes a mesh as a binary PLY file: positions and triangles alone, as physics engines and simulators take it. */
#include <stdio.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "exporters/proxy/mesh.h"

enum { HEADER = 512, VERTEX = 12, TRIANGLE = 13 }; /* bytes */

pags_result pags_mesh_ply_save(const char *path, const pags_proxy_mesh *mesh) {
  const size_t vertices = (size_t)mesh->vertex_count, triangles = (size_t)mesh->triangle_count;
  PAGS_AUTOFREE uint8_t *bytes = malloc(HEADER + vertices * VERTEX + triangles * TRIANGLE);
  PAGS_CHECK_MEMORY(bytes, "%s", path);
  uint8_t *p = bytes + snprintf((char *)bytes, HEADER,
                                "ply\nformat binary_little_endian 1.0\ncomment metres, relative to the scene's origin\n"
                                "element vertex %zu\nproperty float x\nproperty float y\nproperty float z\n"
                                "element face %zu\nproperty list uchar int vertex_indices\nend_header\n",
                                vertices, triangles);
  for (size_t i = 0; i < 3 * vertices; i++, p += 4) {
    uint32_t bits;
    memcpy(&bits, mesh->positions + i, sizeof bits);
    pags_store_u32(p, bits);
  }
  for (size_t i = 0; i < triangles; i++) {
    *p++ = 3;
    for (int c = 0; c < 3; c++, p += 4)
      pags_store_u32(p, mesh->triangles[3 * i + (size_t)c]);
  }
  return pags_file_write(path, bytes, (size_t)(p - bytes));
}
