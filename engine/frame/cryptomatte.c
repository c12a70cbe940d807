/* SPDX-License-Identifier: Apache-2.0 */
/* Hashes of names in a Cryptomatte: MurmurHash3 for 32-bit results (Austin Appleby, public domain) and the
 * specification's conversion to a float (Psyop, Cryptomatte Specification 1.2.0); and the names of a matte. */
#include <pags/passes.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"

static uint32_t rotate(uint32_t x, int by) {
  return x << by | x >> (32 - by);
}

static uint32_t scramble(uint32_t word) {
  return rotate(word * UINT32_C(0xcc9e2d51), 15) * UINT32_C(0x1b873593);
}

uint32_t pags_cryptomatte_hash(const char *name, size_t length) {
  uint32_t hash = 0;
  for (size_t i = 0; i < length / 4; i++)
    hash = rotate(hash ^ scramble(pags_load_u32((const uint8_t *)name + 4 * i)), 13) * 5 + UINT32_C(0xe6546b64);
  uint8_t rest[4] = {0};
  memcpy(rest, name + length / 4 * 4, length % 4);
  hash ^= scramble(pags_load_u32(rest)); /* 0 where nothing is left */
  hash ^= (uint32_t)length;
  hash = (hash ^ hash >> 16) * UINT32_C(0x85ebca6b);
  hash = (hash ^ hash >> 13) * UINT32_C(0xc2b2ae35);
  return hash ^ hash >> 16;
}

float pags_cryptomatte_value(uint32_t hash) {
  const uint32_t exponent = hash >> 23 & 255, kept = exponent < 1 ? 1 : exponent > 254 ? 254 : exponent;
  const uint32_t bits = (hash & ~(UINT32_C(255) << 23)) | kept << 23;
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* ---- Lists of names ---- */

/* Writes the manifest: a JSON object with each name and its hash in eight hexadecimal digits. */
static pags_result put_manifest(pags_matte_names *names) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer writer = {0};
  pags_json_writer_init(&writer, 0);
  pags_json_begin_object(&writer, NULL);
  for (int32_t i = 0; i < names->count; i++) {
    char hash[9];
    snprintf(hash, sizeof hash, "%08x", pags_cryptomatte_hash(names->names[i], strlen(names->names[i])));
    pags_json_put_string(&writer, names->names[i], hash);
  }
  pags_json_end_object(&writer);
  PAGS_TRY(pags_json_writer_finish(&writer));
  names->manifest = pags_text_copy(writer.data);
  PAGS_CHECK_MEMORY(names->manifest, "%d names", names->count);
  names->manifest[strcspn(names->manifest, "\n")] = '\0';
  return PAGS_OK;
}

pags_result pags_matte_names_create(const char *const *labels, int64_t label_count, pags_matte_names *out) {
  const size_t room = (size_t)label_count + 1;
  PAGS_AUTO(pags_matte_names_destroy) pags_matte_names all = {.label_count = label_count};
  *out = (pags_matte_names){0};
  all.names = calloc(room, sizeof *all.names);
  all.values = calloc(room, sizeof *all.values);
  all.name_of_label = calloc(room, sizeof *all.name_of_label);
  PAGS_AUTOFREE const char **sorted = calloc(room, sizeof *sorted);
  PAGS_CHECK_MEMORY(all.names && all.values && all.name_of_label && sorted, "%lld names", (long long)label_count);
  for (int64_t i = 0; i < label_count; i++)
    sorted[i] = labels[i];
  qsort(sorted, (size_t)label_count, sizeof *sorted, pags_text_compare);
  for (int64_t i = 0; i < label_count; i++) {
    if (i > 0 && strcmp(sorted[i], sorted[i - 1]) == 0)
      continue;
    all.names[all.count] = pags_text_copy(sorted[i]);
    PAGS_CHECK_MEMORY(all.names[all.count], "%lld names", (long long)label_count);
    all.values[all.count++] = pags_cryptomatte_value(pags_cryptomatte_hash(sorted[i], strlen(sorted[i])));
  }
  for (int64_t i = 0; i < label_count; i++) {
    char **const found = bsearch(&labels[i], all.names, (size_t)all.count, sizeof *all.names, pags_text_compare);
    all.name_of_label[i] = (int32_t)(found - all.names);
  }
  PAGS_TRY(put_manifest(&all));
  *out = all;
  all = (pags_matte_names){0};
  return PAGS_OK;
}

void pags_matte_names_destroy(pags_matte_names *names) {
  for (int32_t i = 0; names->names && i < names->count; i++)
    free(names->names[i]);
  free(names->names);
  free(names->values);
  free(names->name_of_label);
  free(names->manifest);
  *names = (pags_matte_names){0};
}

pags_result pags_matte_names_of_scene(const pags_scene *scene, int classes, pags_matte_names *out) {
  PAGS_AUTOFREE const char **labels = calloc((size_t)scene->object_count + 1, sizeof *labels);
  *out = (pags_matte_names){0};
  PAGS_CHECK_MEMORY(labels, "%lld names", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    labels[i] = classes ? scene->objects[i].record.class_name : scene->objects[i].record.id;
  labels[scene->object_count] = "background";
  return pags_matte_names_create(labels, scene->object_count + 1, out);
}
