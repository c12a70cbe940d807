/* SPDX-License-Identifier: Apache-2.0 */
/* SOG and glTF files made byte by byte. */
#include "web_files.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "scene/webp.h"

const char *const sog_names[SOG_FILES] = {"meta.json",  "means_l.webp", "means_u.webp",       "scales.webp",
                                          "quats.webp", "sh0.webp",     "shN_centroids.webp", "shN_labels.webp"};

file_bytes make_webp(int width, int height, uint8_t (*value)(int i, int channel)) {
  file_bytes out = {0};
  uint8_t *rgba = malloc(4 * (size_t)(width * height)), *bytes;
  size_t size;
  if (!rgba)
    abort();
  for (int i = 0; i < 4 * width * height; i++)
    rgba[i] = value(i / 4, i % 4);
  if (pags_webp_encode(rgba, width, height, &bytes, &size) == PAGS_OK)
    bytes_put(&out, bytes, size);
  free(bytes);
  free(rgba);
  return out;
}

uint8_t sog_pixel(int file, int i, int channel) {
  static const uint8_t quats[SOG_COUNT][4] = {
      {128, 128, 128, 252}, {255, 0, 128, 253}, {10, 200, 90, 254}, {128, 200, 20, 255}, {60, 70, 80, 252}};
  switch (file) {
    case 4: return i < SOG_COUNT ? quats[i][channel] : 0;
    case 6: return channel == 3 ? 255 : (uint8_t)((5 * i + channel) % 4);
    case 7: return channel == 0 ? (uint8_t)(i % 3) : channel == 3 ? 255 : 0;
    case 3:
    case 5: return channel == 3 ? (uint8_t)(file == 5 ? 51 * i : 255) : (uint8_t)((i + channel) % 4);
    default: return channel == 3 ? 255 : (uint8_t)(37 * i + 11 * channel + file);
  }
}

#define PIXELS(n)                                \
  static uint8_t pixel_##n(int i, int channel) { \
    return sog_pixel(n, i, channel);             \
  }
PIXELS(1)
PIXELS(2)
PIXELS(3)
PIXELS(4)
PIXELS(5)
PIXELS(6)
PIXELS(7)

void make_sog(int version, int sh_degree, file_bytes files[SOG_FILES]) {
  static uint8_t (*const pixels[SOG_FILES])(int, int) = {NULL,    pixel_1, pixel_2, pixel_3,
                                                         pixel_4, pixel_5, pixel_6, pixel_7};
  memset(files, 0, SOG_FILES * sizeof *files);
  for (int k = 1; k < (sh_degree ? 8 : 6); k++)
    files[k] = make_webp(k == 6 ? 192 : 4, k == 6 ? 1 : 4, pixels[k]);
  file_bytes *meta = &files[0];
  if (version == 2) {
    bytes_text(
        meta,
        "{\"version\": 2, \"count\": 5, \"antialias\": true, \"means\": {\"mins\": [-1, -2, 0], \"maxs\": [1, 2, 3], "
        "\"files\": [\"means_l.webp\", \"means_u.webp\"]}, \"scales\": {\"codebook\": [-5, -4, -3, -2], \"files\": "
        "[\"scales.webp\"]}, \"quats\": {\"files\": [\"quats.webp\"]}, \"sh0\": {\"codebook\": [-1, 0, 0.5, 2], "
        "\"files\": [\"sh0.webp\"]}");
    if (sh_degree)
      bytes_text(meta,
                 ", \"shN\": {\"count\": 3, \"bands\": 1, \"codebook\": [-0.5, 0, 0.25, 0.5], \"files\": "
                 "[\"shN_centroids.webp\", \"shN_labels.webp\"]}");
  } else {
    bytes_text(
        meta,
        "{\"means\": {\"shape\": [5, 3], \"dtype\": \"float32\", \"mins\": [-1, -2, 0], \"maxs\": [1, 2, 3], "
        "\"files\": [\"means_l.webp\", \"means_u.webp\"]}, \"scales\": {\"mins\": [-6, -6, -6], \"maxs\": [-1, -1, "
        "0], \"files\": [\"scales.webp\"]}, \"quats\": {\"encoding\": \"quaternion_packed\", \"files\": "
        "[\"quats.webp\"]}, \"sh0\": {\"mins\": [-2, -2, -2, -4], \"maxs\": [2, 2, 3, 5], \"files\": "
        "[\"sh0.webp\"]}");
    if (sh_degree)
      bytes_text(meta,
                 ", \"shN\": {\"shape\": [5, 9], \"mins\": -1, \"maxs\": 1.55, \"quantization\": 8, \"files\": "
                 "[\"shN_centroids.webp\", \"shN_labels.webp\"]}");
  }
  bytes_text(meta, "}");
}

void free_sog(file_bytes files[SOG_FILES]) {
  for (int k = 0; k < SOG_FILES; k++)
    bytes_free(&files[k]);
}

static void put16(file_bytes *out, unsigned value) {
  bytes_u8(out, value & 255);
  bytes_u8(out, value >> 8 & 255);
}

/* Writes the fields that a local header and an entry of the directory have in common. */
static void put_member(file_bytes *out, const file_bytes *packed, const file_bytes *plain, size_t name, int deflate) {
  put16(out, 20);
  put16(out, 0);
  put16(out, deflate ? 8 : 0);
  bytes_u32(out, 0);
  bytes_u32(out, (uint32_t)crc32(0, plain->data, (uInt)plain->size));
  bytes_u32(out, (uint32_t)packed->size);
  bytes_u32(out, (uint32_t)plain->size);
  put16(out, (unsigned)name);
  put16(out, 0);
}

file_bytes make_zip(const char *const *names, const file_bytes *files, int count, const char *prefix, int deflate) {
  file_bytes out = {0}, directory = {0};
  unsigned entries = 0;
  for (int k = 0; k < count; k++) {
    file_bytes packed = {0};
    const size_t name = strlen(prefix) + strlen(names[k]), offset = out.size;
    if (!files[k].size)
      continue;
    entries++;
    if (deflate)
      bytes_stored(&packed, files[k].data, files[k].size);
    else
      bytes_put(&packed, files[k].data, files[k].size);
    bytes_put(&out, "PK\3\4", 4);
    put_member(&out, &packed, &files[k], name, deflate);
    bytes_text(&out, "%s%s", prefix, names[k]);
    bytes_put(&out, packed.data, packed.size);
    bytes_put(&directory, "PK\1\2\24\0", 6);
    put_member(&directory, &packed, &files[k], name, deflate);
    bytes_put(&directory, "\0\0\0\0\0\0\0\0\0\0", 10);
    bytes_u32(&directory, (uint32_t)offset);
    bytes_text(&directory, "%s%s", prefix, names[k]);
    bytes_free(&packed);
  }
  const size_t at = out.size;
  bytes_put(&out, directory.data, directory.size);
  bytes_put(&out, "PK\5\6\0\0\0\0", 8);
  put16(&out, entries);
  put16(&out, entries);
  bytes_u32(&out, (uint32_t)directory.size);
  bytes_u32(&out, (uint32_t)at);
  put16(&out, 0);
  bytes_free(&directory);
  return out;
}

file_bytes make_glb(const char *json, const file_bytes *chunk) {
  file_bytes out = {0};
  const size_t length = (strlen(json) + 3) / 4 * 4, size = (chunk->size + 3) / 4 * 4;
  bytes_put(&out, "glTF\2\0\0\0", 8);
  bytes_u32(&out, (uint32_t)(12 + 8 + length + 8 + size));
  bytes_u32(&out, (uint32_t)length);
  bytes_put(&out, "JSON", 4);
  bytes_put(&out, json, strlen(json));
  while (out.size % 4)
    bytes_u8(&out, ' ');
  bytes_u32(&out, (uint32_t)size);
  bytes_put(&out, "BIN\0", 4);
  bytes_put(&out, chunk->data, chunk->size);
  while (out.size % 4)
    bytes_u8(&out, 0);
  return out;
}
