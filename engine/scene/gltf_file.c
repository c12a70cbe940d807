/* SPDX-License-Identifier: Apache-2.0 */
/* Reads glTF 2.0 files: the chunks of a .glb, buffers in it, in files next to it or as data URIs, views and accessors
 * with strides and all component types. */
#include "scene/gltf_file.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

enum { GLB_HEADER = 12, CHUNK_HEADER = 8 };

/* ---- Document ---- */

pags_result pags_gltf_refer(const gltf_file *f, const pags_json_value *object, const char *key, gltf_array array,
                            const pags_json_value **out) {
  const gltf_list *const list = &f->lists[array];
  int64_t index;
  *out = NULL;
  PAGS_TRY(pags_json_integer_or(f->json, object, key, 0, INT32_MAX, -1, &index));
  if (index < 0)
    return PAGS_OK;
  if (index >= list->count)
    return pags_json_fail(f->json, object, "expected '%s' below %lld, found %lld", key, (long long)list->count,
                          (long long)index);
  *out = list->items[index];
  return PAGS_OK;
}

/* Finds JSON and binary chunk of a .glb. */
static pags_result read_chunks(gltf_file *f, const uint8_t *bytes, size_t size, const char **text, size_t *length) {
  if (size < GLB_HEADER + CHUNK_HEADER)
    return pags_fail_at(f->path, "a .glb of %zu bytes is cut off", size);
  const uint32_t version = pags_load_u32(bytes + 4), json_size = pags_load_u32(bytes + GLB_HEADER);
  if (version != 2)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: glTF version %u; version 2 can be read", f->path, version);
  size_t left = size - GLB_HEADER - CHUNK_HEADER;
  if (pags_load_u32(bytes + 16) != 0x4e4f534a || json_size > left)
    return pags_fail_at(f->path, "byte 12: expected a JSON chunk within the file's %zu bytes", size);
  *text = (const char *)bytes + GLB_HEADER + CHUNK_HEADER;
  *length = json_size;
  const uint8_t *rest = bytes + GLB_HEADER + CHUNK_HEADER + json_size;
  left -= json_size;
  if (left < CHUNK_HEADER)
    return PAGS_OK;
  const uint32_t chunk = pags_load_u32(rest);
  if (pags_load_u32(rest + 4) != 0x004e4942)
    return PAGS_OK; /* another chunk, which readers ignore */
  if (chunk > left - CHUNK_HEADER)
    return pags_fail_at(f->path, "the binary chunk needs %u bytes, %zu are there: the file is cut off", chunk,
                        left - CHUNK_HEADER);
  f->chunk = (gltf_buffer){rest + CHUNK_HEADER, chunk, NULL};
  return PAGS_OK;
}

pags_result pags_gltf_open(const char *path, const uint8_t *bytes, size_t size, gltf_file *f) {
  static const char *const keys[GLTF_LISTS] = {"nodes", "meshes", "accessors", "bufferViews", "buffers"};
  *f = (gltf_file){.path = path};
  const char *text = (const char *)bytes;
  size_t length = size;
  if (size >= 4 && memcmp(bytes, "glTF", 4) == 0)
    PAGS_TRY(read_chunks(f, bytes, size, &text, &length));
  PAGS_TRY(pags_json_parse_text(f->path, text, length, &f->json));
  f->root = pags_json_root(f->json);
  PAGS_TRY(pags_json_as_object(f->json, f->root, "a glTF document"));
  for (int i = 0; i < GLTF_LISTS; i++) {
    const pags_json_value *array = pags_json_member(f->root, keys[i]);
    if (!array || array->type != PAGS_JSON_ARRAY)
      continue;
    gltf_list *const list = &f->lists[i];
    list->items = calloc((size_t)array->count + 1, sizeof *list->items);
    PAGS_CHECK_MEMORY(list->items, "%s: '%s'", path, keys[i]);
    for (const pags_json_value *v = array->first; v; v = v->next) {
      PAGS_TRY(pags_json_as_object(f->json, v, keys[i]));
      list->items[list->count++] = v;
    }
  }
  f->buffers = calloc((size_t)f->lists[GLTF_BUFFERS].count + 1, sizeof *f->buffers);
  PAGS_CHECK_MEMORY(f->buffers, "%s", path);
  return PAGS_OK;
}

void pags_gltf_close(gltf_file *f) {
  for (int64_t i = 0; f->buffers && i < f->lists[GLTF_BUFFERS].count; i++)
    free(f->buffers[i].owned);
  free(f->buffers);
  for (int i = 0; i < GLTF_LISTS; i++)
    free(f->lists[i].items);
  pags_json_destroy(f->json);
}

/* ---- Buffers ---- */

/* Decodes the text of a data URI behind its comma. */
static pags_result read_data_uri(const gltf_file *f, const char *text, gltf_buffer *out) {
  out->owned = malloc(strlen(text) / 4 * 3 + 4);
  PAGS_CHECK_MEMORY(out->owned, "%s: a buffer", f->path);
  /* The last two are those of the alphabet for URLs, in place of the two before. */
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/-_";
  uint32_t bits = 0;
  int held = 0;
  for (; *text && *text != '='; text++) {
    const char *const found = strchr(digits, *text);
    if (!found)
      return pags_fail_at(f->path, "a buffer's data URI: expected base64, found '%c'", *text);
    const uint32_t digit = (uint32_t)(found - digits);
    bits = (bits << 6 | (digit < 64 ? digit : digit - 2)) & 0xffffff;
    held += 6;
    if (held >= 8) {
      held -= 8;
      out->owned[out->size++] = (uint8_t)(bits >> held);
    }
  }
  out->bytes = out->owned;
  return PAGS_OK;
}

/* Replaces %XX of a URI by its character, in place. */
static void unescape(char *text) {
  char *to = text;
  for (const char *from = text; *from; from++) {
    unsigned value;
    if (*from == '%' && sscanf(from + 1, "%2x", &value) == 1 && value && from[1] && from[2]) {
      *to++ = (char)value;
      from += 2;
    } else
      *to++ = *from;
  }
  *to = 0;
}

static pags_result read_file_uri(const gltf_file *f, const char *uri, gltf_buffer *out) {
  char name[1024];
  snprintf(name, sizeof name, "%s", uri);
  unescape(name);
  if (!pags_path_is_inside(name) || strlen(uri) >= sizeof name)
    return pags_fail_at(f->path, "expected buffers in files of the same folder, found '%.80s'", uri);
  PAGS_AUTOFREE char *folder = pags_path_folder(f->path);
  PAGS_AUTOFREE char *path = folder ? pags_path_join(folder, name) : NULL;
  PAGS_CHECK_MEMORY(path, "%s: a path", f->path);
  PAGS_TRY(pags_file_read(path, &out->owned, &out->size));
  out->bytes = out->owned;
  return PAGS_OK;
}

static pags_result find_buffer(gltf_file *f, int64_t index, const gltf_buffer **out) {
  gltf_buffer *buffer = &f->buffers[index];
  const pags_json_value *const value = f->lists[GLTF_BUFFERS].items[index];
  const char *uri;
  *out = buffer;
  if (buffer->bytes)
    return PAGS_OK;
  PAGS_TRY(pags_json_string_or(f->json, value, "uri", NULL, &uri));
  if (!uri) {
    if (index > 0 || !f->chunk.bytes)
      return pags_json_fail(f->json, value, "buffer %lld has neither a file nor a chunk", (long long)index);
    *buffer = f->chunk;
    return PAGS_OK;
  }
  if (strncmp(uri, "data:", 5) != 0)
    return read_file_uri(f, uri, buffer);
  const char *comma = strstr(uri, ";base64,");
  if (!comma)
    return pags_json_fail(f->json, value, "expected a data URI in base64");
  return read_data_uri(f, comma + 8, buffer);
}

/* ---- Accessors ---- */

typedef struct layout {
  int64_t count;
  int type, components; /* type: componentType as a small number 0..6 */
  bool normalised;
  size_t stride;
  const uint8_t *first;
} layout;

/* Bytes of the component types 5120 to 5126; 5124 is not one. */
static const size_t component_bytes[7] = {1, 1, 2, 2, 0, 4, 4};

/* Finds the accessor's elements and checks that all of them lie in its view and the view in its buffer. */
static pags_result find_layout(gltf_file *f, const pags_json_value *accessor, layout *out) {
  const pags_json_value *view;
  const char *type;
  int64_t component, offset, view_offset, view_length, stride, buffer_index;
  PAGS_TRY(pags_json_integer(f->json, accessor, "count", 1, INT32_MAX, &out->count));
  PAGS_TRY(pags_json_integer(f->json, accessor, "componentType", 5120, 5126, &component));
  PAGS_TRY(pags_json_string(f->json, accessor, "type", &type));
  PAGS_TRY(pags_json_bool_or(f->json, accessor, "normalized", false, &out->normalised));
  PAGS_TRY(pags_json_integer_or(f->json, accessor, "byteOffset", 0, INT64_MAX / 4, 0, &offset));
  out->type = (int)(component - 5120);
  static const char *const types[4] = {"SCALAR", "VEC2", "VEC3", "VEC4"};
  out->components = 1 + pags_text_find(type, types, 4);
  if (!out->components || !component_bytes[out->type])
    return pags_json_fail(f->json, accessor, "expected a scalar or a vector of numbers, found '%.20s' of type %lld",
                          type, (long long)component);
  if (pags_json_member(accessor, "sparse"))
    return pags_json_fail(f->json, accessor, "sparse accessors can't be read: expected one with all its values");
  PAGS_TRY(pags_gltf_refer(f, accessor, "bufferView", GLTF_VIEWS, &view));
  if (!view)
    return pags_json_fail(
        f->json, accessor,
        "expected a 'bufferView': without it all values are zero, or packed by an extension that PAGS doesn't read");
  PAGS_TRY(pags_json_integer(f->json, view, "buffer", 0, INT32_MAX, &buffer_index));
  PAGS_TRY(pags_json_integer_or(f->json, view, "byteOffset", 0, INT64_MAX / 4, 0, &view_offset));
  PAGS_TRY(pags_json_integer(f->json, view, "byteLength", 1, INT64_MAX / 4, &view_length));
  const size_t each = component_bytes[out->type] * (size_t)out->components;
  PAGS_TRY(pags_json_integer_or(f->json, view, "byteStride", 1, 65535, (int64_t)each, &stride));
  if (buffer_index >= f->lists[GLTF_BUFFERS].count)
    return pags_json_fail(f->json, view, "expected 'buffer' below %lld, found %lld",
                          (long long)f->lists[GLTF_BUFFERS].count, (long long)buffer_index);
  const gltf_buffer *buffer;
  PAGS_TRY(find_buffer(f, buffer_index, &buffer));
  out->stride = (size_t)stride;
  const int64_t need = (out->count - 1) * stride + (int64_t)each;
  if (out->stride < each || view_offset > (int64_t)buffer->size || view_length > (int64_t)buffer->size - view_offset ||
      offset > view_length || need > view_length - offset)
    return pags_json_fail(
        f->json, accessor,
        "%lld elements of %zu bytes at every %lld reach beyond the %lld bytes of their view or the %zu of its buffer",
        (long long)out->count, each, (long long)stride, (long long)view_length, buffer->size);
  out->first = buffer->bytes + view_offset + offset;
  return PAGS_OK;
}

pags_result pags_gltf_accessor_count(gltf_file *f, const pags_json_value *accessor, int64_t *count) {
  layout found;
  PAGS_TRY(find_layout(f, accessor, &found));
  *count = found.count;
  return PAGS_OK;
}

static float component(const uint8_t *p, int type, bool normalised) {
  switch (type) {
    case 0: return normalised ? (float)((int8_t)p[0] < -127 ? -1 : (int8_t)p[0] / 127.0) : (float)(int8_t)p[0];
    case 1: return normalised ? (float)(p[0] / 255.0) : (float)p[0];
    case 2: {
      const int16_t value = (int16_t)pags_load_u16(p);
      return normalised ? (float)(value < -32767 ? -1 : value / 32767.0) : (float)value;
    }
    case 3: return normalised ? (float)(pags_load_u16(p) / 65535.0) : (float)pags_load_u16(p);
    case 5: return (float)pags_load_u32(p);
    default: return pags_load_f32(p);
  }
}

pags_result pags_gltf_accessor_read(gltf_file *f, const pags_json_value *accessor, const char *what, int64_t count,
                                    int components, float *out) {
  layout l;
  PAGS_TRY(find_layout(f, accessor, &l));
  if (l.count != count || (l.components != components && !(components == 3 && l.components == 4)))
    return pags_json_fail(f->json, accessor, "%s: expected %lld elements of %d numbers, found %lld of %d", what,
                          (long long)count, components, (long long)l.count, l.components);
  for (int64_t i = 0; i < count; i++)
    for (int c = 0; c < components; c++)
      out[i * components + c] =
          component(l.first + (size_t)i * l.stride + (size_t)c * component_bytes[l.type], l.type, l.normalised);
  return PAGS_OK;
}
