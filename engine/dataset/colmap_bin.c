/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the binary files of a COLMAP model: little-endian, 64-bit counts, records without padding. Every count is
 * compared with the number of bytes left in the file before memory is allocated for it. */
#include "dataset/colmap.h"

#include <stdio.h>
#include <string.h>

#include "base/memory.h"

typedef struct cursor {
  const pags_colmap_bytes *bytes;
  size_t at;
} cursor;

static pags_result ends(const cursor *c) {
  return pags_fail(PAGS_ERROR_FORMAT, "%s: ends at byte %zu within a record", c->bytes->path, c->bytes->size);
}

static pags_result take(cursor *c, void *out, size_t size) {
  if (c->bytes->size - c->at < size)
    return ends(c);
  memcpy(out, c->bytes->data + c->at, size);
  c->at += size;
  return PAGS_OK;
}

static pags_result take_u32(cursor *c, int64_t *out) {
  uint32_t value = 0;
  PAGS_TRY(take(c, &value, sizeof value));
  *out = value;
  return PAGS_OK;
}

/* Reads a 64-bit count of records, each at least `record` bytes long. Fails when that many records don't fit into the
 * rest of the file. */
static pags_result take_count(cursor *c, size_t record, const char *what, int64_t *out) {
  uint64_t value = 0;
  size_t at = c->at;
  PAGS_TRY(take(c, &value, sizeof value));
  if (value > (c->bytes->size - c->at) / record)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: byte %zu: %llu %s, more than the file has room for", c->bytes->path, at,
                     (unsigned long long)value, what);
  *out = (int64_t)value;
  return PAGS_OK;
}

pags_result pags_colmap_cameras_bin(pags_colmap *model, const pags_colmap_bytes *bytes) {
  cursor c = {.bytes = bytes};
  int64_t count = 0;
  PAGS_TRY(take_count(&c, 24 + 2 * sizeof(double), "cameras", &count));
  for (int64_t i = 0; i < count; i++) {
    pags_colmap_camera *camera = pags_colmap_add_camera(model);
    PAGS_CHECK_MEMORY(camera, "%s", c.bytes->path);
    int64_t number;
    uint64_t size[2];
    double parameters[PAGS_COLMAP_PARAMETERS];
    PAGS_TRY(take_u32(&c, &camera->id));
    PAGS_TRY(take_u32(&c, &number));
    int kind; /* if not known, nor is the number of its parameters, so that nothing behind it can be read */
    PAGS_TRY(pags_colmap_find_kind(c.bytes->path, NULL, number, &kind));
    PAGS_TRY(take(&c, size, sizeof size));
    PAGS_TRY(take(&c, parameters, (size_t)pags_colmap_parameters(kind) * sizeof(double)));
    if (size[0] > 65535 || size[1] > 65535) {
      PAGS_TRY(pags_colmap_keep_problem(
          model, pags_fail(PAGS_ERROR_FORMAT, "%s: camera %lld: %llu x %llu pixels, expected 1..65535", c.bytes->path,
                           (long long)camera->id, (unsigned long long)size[0], (unsigned long long)size[1])));
      continue;
    }
    camera->lens.width = (int)size[0];
    camera->lens.height = (int)size[1];
    pags_colmap_set_lens(kind, parameters, &camera->lens);
  }
  return pags_colmap_sort_cameras(model, bytes->path);
}

pags_result pags_colmap_images_bin(pags_colmap *model, const pags_colmap_bytes *bytes) {
  cursor c = {.bytes = bytes};
  int64_t count = 0;
  PAGS_TRY(take_count(&c, 4 + 7 * sizeof(double) + 4 + 1 + 8, "images", &count));
  for (int64_t i = 0; i < count; i++) {
    pags_colmap_image image;
    PAGS_TRY(take_u32(&c, &image.id));
    PAGS_TRY(take(&c, image.pose, sizeof image.pose));
    PAGS_TRY(take_u32(&c, &image.camera));
    const uint8_t *name = c.bytes->data + c.at;
    const uint8_t *stop = memchr(name, 0, c.bytes->size - c.at);
    if (!stop)
      return ends(&c);
    image.name = (const char *)name;
    c.at += (size_t)(stop - name) + 1;
    int64_t observations = 0;
    const size_t observation = 2 * sizeof(double) + sizeof(uint64_t);
    PAGS_TRY(take_count(&c, observation, "observations", &observations));
    c.at += (size_t)observations * observation;
    PAGS_TRY(pags_colmap_add_image(model, c.bytes->path, &image));
  }
  return PAGS_OK;
}

pags_result pags_colmap_points_bin(pags_colmap *model, const pags_colmap_bytes *bytes) {
  cursor c = {.bytes = bytes};
  int64_t count = 0;
  PAGS_TRY(take_count(&c, 8 + 3 * sizeof(double) + 3 + 8 + 8, "points", &count));
  for (int64_t i = 0; i < count; i++) {
    uint64_t id = 0;
    double xyz[3], error;
    uint8_t rgb[3];
    int64_t observers = 0, view, observation;
    PAGS_TRY(take(&c, &id, sizeof id));
    PAGS_TRY(take(&c, xyz, sizeof xyz));
    PAGS_TRY(take(&c, rgb, sizeof rgb));
    PAGS_TRY(take(&c, &error, sizeof error));
    PAGS_TRY(take_count(&c, 8, "observers of a point", &observers));
    PAGS_TRY(pags_parsed_add_point(&model->parsed->points, (int64_t)id, xyz, rgb, bytes->path));
    for (int64_t k = 0; k < observers; k++) {
      PAGS_TRY(take_u32(&c, &view));
      PAGS_TRY(take_u32(&c, &observation));
      PAGS_TRY(pags_parsed_observe(&model->parsed->points, view, bytes->path));
    }
  }
  return PAGS_OK;
}
