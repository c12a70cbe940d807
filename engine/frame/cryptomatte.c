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

static int compare_texts(const void *a, const void *b) {
  return strcmp(*(const char *const *)a, *(const char *const *)b);
}

/* Writes the manifest: a JSON object with each name and its hash in eight hexadecimal digits. */
static pags_result put_manifest(pags_matte_names *names) {
  pags_json_writer writer;
  pags_json_writer_init(&writer, 0);
  pags_json_begin_object(&writer, NULL);
  for (int32_t i = 0; i < names->count; i++) {
    char hash[9];
    snprintf(hash, sizeof hash, "%08x", pags_cryptomatte_hash(names->names[i], strlen(names->names[i])));
    pags_json_put_string(&writer, names->names[i], hash);
  }
  pags_json_end_object(&writer);
  pags_result result = pags_json_writer_finish(&writer);
  names->manifest = result == PAGS_OK ? pags_text_copy(writer.data) : NULL;
  pags_json_writer_destroy(&writer);
  if (result == PAGS_OK && !names->manifest)
    result = pags_out_of_memory("%d names", names->count);
  if (result == PAGS_OK)
    names->manifest[strcspn(names->manifest, "\n")] = '\0';
  return result;
}

pags_result pags_matte_names_create(const char *const *labels, int64_t label_count, pags_matte_names *out) {
  const size_t room = (size_t)label_count + 1;
  *out = (pags_matte_names){.label_count = label_count};
  out->names = calloc(room, sizeof *out->names);
  out->values = calloc(room, sizeof *out->values);
  out->name_of_label = calloc(room, sizeof *out->name_of_label);
  const char **const sorted = calloc(room, sizeof *sorted);
  pags_result result = out->names && out->values && out->name_of_label && sorted
                           ? PAGS_OK
                           : pags_out_of_memory("%lld names", (long long)label_count);
  for (int64_t i = 0; i < label_count && result == PAGS_OK; i++)
    sorted[i] = labels[i];
  if (result == PAGS_OK)
    qsort(sorted, (size_t)label_count, sizeof *sorted, compare_texts);
  for (int64_t i = 0; i < label_count && result == PAGS_OK; i++) {
    if (i > 0 && strcmp(sorted[i], sorted[i - 1]) == 0)
      continue;
    out->names[out->count] = pags_text_copy(sorted[i]);
    out->values[out->count] = pags_cryptomatte_value(pags_cryptomatte_hash(sorted[i], strlen(sorted[i])));
    if (!out->names[out->count++])
      result = pags_out_of_memory("%lld names", (long long)label_count);
  }
  for (int64_t i = 0; i < label_count && result == PAGS_OK; i++) {
    char **const found = bsearch(&labels[i], out->names, (size_t)out->count, sizeof *out->names, compare_texts);
    out->name_of_label[i] = (int32_t)(found - out->names);
  }
  free(sorted);
  if (result == PAGS_OK)
    result = put_manifest(out);
  if (result != PAGS_OK)
    pags_matte_names_destroy(out);
  return result;
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
  const char **const labels = calloc((size_t)scene->object_count + 1, sizeof *labels);
  *out = (pags_matte_names){0};
  if (!labels)
    return pags_out_of_memory("%lld names", (long long)scene->object_count);
  for (int64_t i = 0; i < scene->object_count; i++)
    labels[i] = classes ? scene->objects[i].record.class_name : scene->objects[i].record.id;
  labels[scene->object_count] = "background";
  const pags_result result = pags_matte_names_create(labels, scene->object_count + 1, out);
  free(labels);
  return result;
}
