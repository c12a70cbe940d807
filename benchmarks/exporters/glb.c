/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the JSON and the meshes of a GLB file, for pags-bench proxies. */
#include "benchmarks/exporters/glb.h"

#include <stdlib.h>
#include <string.h>

#include <pags/camera.h>

#include "base/file.h"

const pags_json_value *pags_glb_member(const pags_json_value *object, const char *key) {
  return object ? pags_json_member(object, key) : NULL;
}

static uint32_t word_at(const uint8_t *bytes) {
  uint32_t word;
  memcpy(&word, bytes, 4);
  return word;
}

pags_result pags_glb_open(const char *path, pags_glb *out) {
  *out = (pags_glb){0};
  PAGS_TRY(pags_file_read(path, &out->bytes, &out->size));
  size_t json_size = out->size > 28 ? word_at(out->bytes + 12) : 0;
  if (json_size == 0 || json_size > out->size - 28)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: no GLB with a buffer", path);
  out->buffer = out->bytes + 28 + json_size;
  out->buffer_size = out->size - 28 - json_size;
  PAGS_TRY(pags_json_parse_text(path, (const char *)out->bytes + 20, json_size, &out->json));
  out->root = pags_json_root(out->json);
  return PAGS_OK;
}

void pags_glb_close(pags_glb *file) {
  pags_json_destroy(file->json);
  free(file->bytes);
}

const char *pags_glb_text(const pags_json_value *object, const char *key) {
  const pags_json_value *value = pags_glb_member(object, key);
  return value && value->type == PAGS_JSON_STRING ? value->text : NULL;
}

const pags_json_value *pags_glb_element(const pags_glb *file, const char *list, int64_t index) {
  const pags_json_value *at = pags_glb_member(file->root, list);
  at = at ? at->first : NULL;
  while (at && index-- > 0)
    at = at->next;
  return at;
}

int64_t pags_glb_integer(const pags_json_value *object, const char *key, int64_t fallback) {
  const pags_json_value *value = pags_glb_member(object, key);
  return value && value->type == PAGS_JSON_NUMBER ? (int64_t)value->number : fallback;
}

static void numbers(const pags_json_value *object, const char *key, double *values, int count) {
  const pags_json_value *at = pags_glb_member(object, key);
  at = at ? at->first : NULL;
  for (int i = 0; at && i < count; at = at->next)
    values[i++] = at->number;
}

void pags_glb_pose(const pags_json_value *node, double pose[12]) {
  double place[3] = {0}, turn[4] = {0, 0, 0, 1}, scale[3] = {1, 1, 1}, r[9];
  numbers(node, "translation", place, 3);
  numbers(node, "rotation", turn, 4);
  numbers(node, "scale", scale, 3);
  pags_rotation_from_quaternion((const double[4]){turn[3], turn[0], turn[1], turn[2]}, r);
  for (int i = 0; i < 9; i++)
    r[i] *= scale[i % 3];
  pags_pose_make(r, place, pose);
}

/* Finds the values of an accessor in the buffer; NULL if they exceed it. `item_bytes` 0: the values are indices of 2
 * or 4 bytes, by the component type. */
static const uint8_t *values_of(const pags_glb *file, int64_t accessor, int64_t item_bytes, int64_t *count,
                                int64_t *component) {
  const pags_json_value *a = pags_glb_element(file, "accessors", accessor);
  const pags_json_value *view = pags_glb_element(file, "bufferViews", pags_glb_integer(a, "bufferView", -1));
  *count = pags_glb_integer(a, "count", 0);
  *component = pags_glb_integer(a, "componentType", 0);
  int64_t at = pags_glb_integer(view, "byteOffset", 0) + pags_glb_integer(a, "byteOffset", 0);
  int64_t bytes = *count * (item_bytes ? item_bytes : *component == 5123 ? 2 : 4);
  return a && view && at >= 0 && *count > 0 && at + bytes <= (int64_t)file->buffer_size ? file->buffer + at : NULL;
}

pags_result pags_glb_mesh(const pags_glb *file, int64_t mesh, pags_proxy_mesh *out) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const pags_json_value *primitive = pags_glb_member(pags_glb_element(file, "meshes", mesh), "primitives");
  primitive = primitive ? primitive->first : NULL;
  int64_t vertices = 0, indices = 0, component = 0;
  const uint8_t *positions = values_of(file, pags_glb_integer(pags_glb_member(primitive, "attributes"), "POSITION", -1),
                                       12, &vertices, &component);
  const uint8_t *corners = values_of(file, pags_glb_integer(primitive, "indices", -1), 0, &indices, &component);
  *out = (pags_proxy_mesh){0};
  if (!positions || !corners)
    return pags_fail(PAGS_ERROR_FORMAT, "mesh %lld can't be read", (long long)mesh);
  for (int64_t i = 0; i < vertices; i++) {
    float p[3];
    memcpy(p, positions + 12 * i, sizeof p);
    pags_proxy_mesh_vertex(out, p, grey, 1);
  }
  for (int64_t i = 0; i + 2 < indices; i += 3) {
    uint32_t c[3];
    for (int k = 0; k < 3; k++) {
      uint16_t narrow;
      memcpy(&narrow, corners + 2 * (i + k), 2);
      c[k] = component == 5123 ? narrow : word_at(corners + 4 * (i + k));
      if (c[k] >= vertices)
        return pags_fail(PAGS_ERROR_FORMAT, "mesh %lld: a corner is out of range", (long long)mesh);
    }
    pags_proxy_mesh_triangle(out, c[0], c[1], c[2]);
  }
  return pags_proxy_mesh_check(out);
}
