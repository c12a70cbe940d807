/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the point cloud of a PLY file by the table that splat files are read by (scene/ply_table.h): positions and
 * colours of the vertices; other properties are skipped. The file may be one of splats, too: the constant terms of
 * their harmonics are the colours. */
#include "dataset/parsed.h"

#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "scene/ply_table.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct cloud {
  const ply_table *table;
  const ply_element *vertex;
  const ply_property *xyz[3], *rgb[3]; /* rgb NULL: not there */
  bool harmonics;                      /* rgb are f_dc_0 to f_dc_2 */
} cloud;

/* Finds the colours by the names that programs give them; of several sets, the first that lacks least. */
static void find_colours(cloud *c) {
  static const char *const names[4][3] = {{"red", "green", "blue"},
                                          {"r", "g", "b"},
                                          {"diffuse_red", "diffuse_green", "diffuse_blue"},
                                          {"f_dc_0", "f_dc_1", "f_dc_2"}};
  int most = 0;
  for (int i = 0; i < 4; i++) {
    const ply_property *found[3];
    int count = 0;
    for (int k = 0; k < 3; k++) {
      found[k] = pags_ply_property_find(c->table, c->vertex, names[i][k]);
      count += found[k] != NULL;
    }
    if (count <= most)
      continue;
    most = count;
    memcpy(c->rgb, found, sizeof found);
    c->harmonics = i == 3;
  }
}

/* Converts a colour to a byte. 16-bit unsigned integers hold 0..65535, all other integers 0..255, floats 0..1. */
static uint8_t colour_of(const cloud *c, int channel, int64_t row) {
  if (!c->rgb[channel])
    return 128;
  const ply_type type = c->rgb[channel]->type;
  const double value = pags_ply_value(c->table, c->vertex, c->rgb[channel], row);
  const double byte = c->harmonics                              ? (0.5 + PAGS_SH_C0 * value) * 255
                      : type == PLY_FLOAT || type == PLY_DOUBLE ? value * 255
                      : type == PLY_USHORT                      ? value / 257
                                                                : value;
  return (uint8_t)(byte > 0 ? (byte < 255 ? byte + 0.5 : 255) : 0);
}

/* Reads all points; those that aren't at a finite place are left out, with a warning. */
static pags_result read_points(const cloud *c, pags_parsed_points *points) {
  const char *const path = c->table->path;
  int64_t left_out = 0, first = 0;
  for (int64_t i = 0; i < c->vertex->count; i++) {
    double xyz[3];
    uint8_t rgb[3];
    for (int k = 0; k < 3; k++) {
      xyz[k] = c->table->facts.origin[k] + pags_ply_value(c->table, c->vertex, c->xyz[k], i);
      rgb[k] = colour_of(c, k, i);
    }
    if (!isfinite(xyz[0]) || !isfinite(xyz[1]) || !isfinite(xyz[2])) {
      first = left_out++ ? first : i;
      continue;
    }
    PAGS_TRY(pags_parsed_add_point(points, i, xyz, rgb, path));
  }
  if (left_out && left_out == c->vertex->count)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected points with finite coordinates, found none among %lld", path,
                     (long long)c->vertex->count);
  if (left_out)
    PAGS_WARN("%s: %lld of %lld points are left out, since a coordinate isn't finite; the first is vertex %lld", path,
              (long long)left_out, (long long)c->vertex->count, (long long)first);
  return PAGS_OK;
}

static pags_result read_cloud(const ply_table *table, pags_parsed_points *points) {
  static const char *const names[3] = {"x", "y", "z"};
  cloud c = {.table = table, .vertex = pags_ply_table_find(table, "vertex")};
  if (!c.vertex)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected an element 'vertex'", table->path);
  for (int k = 0; k < 3; k++) {
    c.xyz[k] = pags_ply_property_find(table, c.vertex, names[k]);
    if (!c.xyz[k])
      return pags_fail(PAGS_ERROR_FORMAT, "%s: no property '%s' in element 'vertex': expected vertices with x, y and z",
                       table->path, names[k]);
  }
  find_colours(&c);
  PAGS_TRY(pags_ply_table_need(table, c.vertex));
  return read_points(&c, points);
}

pags_result pags_ply_points_read(const char *path, pags_parsed_points *points) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  PAGS_AUTO(pags_ply_table_close) ply_table table = {0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  PAGS_TRY(pags_ply_table_open(&table, path, bytes, size));
  return read_cloud(&table, points);
}
