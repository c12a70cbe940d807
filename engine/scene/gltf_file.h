/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the parts of a glTF 2.0 file: its JSON, buffers, and accessors as floats. Independent of what they hold. */
#ifndef PAGS_SCENE_GLTF_FILE_H
#define PAGS_SCENE_GLTF_FILE_H

#include "base/json.h"

/* The arrays of the document. */
typedef enum gltf_array { GLTF_NODES, GLTF_MESHES, GLTF_ACCESSORS, GLTF_VIEWS, GLTF_BUFFERS, GLTF_LISTS } gltf_array;

/* The children of one of them by their index. */
typedef struct gltf_list {
  int64_t count;
  const pags_json_value **items;
} gltf_list;

typedef struct gltf_buffer {
  const uint8_t *bytes; /* NULL until it is read */
  size_t size;
  uint8_t *owned; /* the same block if it isn't part of the .glb */
} gltf_buffer;

typedef struct gltf_file {
  const char *path;
  pags_json *json;
  const pags_json_value *root;
  gltf_list lists[GLTF_LISTS];
  gltf_buffer *buffers;
  gltf_buffer chunk; /* the binary chunk of a .glb */
} gltf_file;

/* Opens a .glb, or the JSON of a .gltf. `bytes` and `path` must outlive the file, which the caller closes, also on
 * failure. */
pags_result pags_gltf_open(const char *path, const uint8_t *bytes, size_t size, gltf_file *out);
void pags_gltf_close(gltf_file *file);

/* Returns the child that the index `key` of `object` names in an array; NULL without such a key. An index beyond the
 * array is an error. */
pags_result pags_gltf_refer(const gltf_file *file, const pags_json_value *object, const char *key, gltf_array array,
                            const pags_json_value **out);

/* Reads how many elements the accessor has, checked against the bytes that are there. */
pags_result pags_gltf_accessor_count(gltf_file *file, const pags_json_value *accessor, int64_t *count);

/* Reads an accessor of `components` components (of 4 for 3: the first three) as floats, normalised where it says so, to
 * `out`: count * components numbers. Fails if it has another type or count. `what` names it in messages. */
pags_result pags_gltf_accessor_read(gltf_file *file, const pags_json_value *accessor, const char *what, int64_t count,
                                    int components, float *out);

#endif
