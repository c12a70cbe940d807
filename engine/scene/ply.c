/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the PLY files of INRIA's 3D Gaussian splatting (Kerbl et al. 2023): properties are found by name
 * in any order and written in INRIA's order, with the optional s_sem, object_id and Fourier terms after them.
 *
 * f_rest is channel-major in the file (all of R, then G, then B) and coefficient-major in memory. Values are not
 * changed, so that reading and writing gives the same bytes. Normals are not read; they are written as zeros. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include <pags/scene.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/splat_formats.h"

enum { NORMALS = 3, MAX_COLUMNS = PAGS_MAX_PLANES + NORMALS, BLOCK_ROWS = 256, NAME_SIZE = 24 };
enum { FOURIER_TERMS = 4, FOURIER_PLANES = 3 * FOURIER_TERMS };

/* ---- Columns ---- */

/* A column of the file: the name of its property and the plane that holds it in memory, -1 for a normal. */
typedef struct column {
  char name[NAME_SIZE];
  int plane;
} column;

/* Appends `count` columns named stem_0, stem_1, ... for planes from `first_plane` on and moves *at behind them. */
static void put_columns(column **at, const char *stem, int count, int first_plane) {
  for (int i = 0; i < count; ++i, ++*at) {
    snprintf((*at)->name, NAME_SIZE, "%s_%d", stem, i);
    (*at)->plane = first_plane + i;
  }
}

/* Lists the columns of a file of SH degree `sh_degree` in INRIA's order. Returns their number. */
static int list_columns(int sh_degree, column columns[MAX_COLUMNS]) {
  static const char *const plain[] = {"x", "y", "z", "nx", "ny", "nz"};
  column *at = columns;
  for (int i = 0; i < 6; ++i, ++at) {
    snprintf(at->name, NAME_SIZE, "%s", plain[i]);
    at->plane = i < 3 ? PAGS_MEAN + i : -1;
  }
  put_columns(&at, "f_dc", 3, PAGS_SH);
  int rest = pags_sh_coefficients(sh_degree) - 1;
  for (int i = 0; i < 3 * rest; ++i, ++at) {
    snprintf(at->name, NAME_SIZE, "f_rest_%d", i);
    at->plane = PAGS_SH + 3 * (1 + i % rest) + i / rest;
  }
  snprintf(at->name, NAME_SIZE, "opacity");
  at++->plane = PAGS_OPACITY;
  put_columns(&at, "scale", 3, PAGS_SCALE);
  put_columns(&at, "rot", 4, PAGS_ROTATION);
  return (int)(at - columns);
}

/* ---- Reading ---- */

/* Derives the SH degree, 0 to 4, from the number of properties whose names begin with f_rest_. */
static pags_result find_degree(const ply_table *table, const ply_element *vertex, int *degree) {
  int rest = 0;
  for (int i = 0; i < vertex->property_count; i++)
    rest += strncmp(table->properties[vertex->first_property + i].name, "f_rest_", 7) == 0;
  for (*degree = 0; *degree <= 4; ++*degree)
    if (rest == 3 * (pags_sh_coefficients(*degree) - 1))
      return PAGS_OK;
  return pags_fail(PAGS_ERROR_FORMAT, "%s: expected 0, 9, 24, 45 or 72 properties f_rest_*, found %d", table->path,
                   rest);
}

static void fill(pags_gaussians *g, int plane, float value) {
  for (int64_t i = 0; i < g->count; i++)
    pags_plane(g, plane)[i] = value;
}

/* Reads red, green, blue (nerfstudio's --ply-color-mode rgb) as the constant colour. Whole numbers are of the type's
 * whole range, others of 0 to 1. */
static void read_rgb(const ply_table *table, const ply_element *vertex, const ply_property *const rgb[3],
                     pags_gaussians *out) {
  for (int k = 0; k < 3; k++) {
    float *const values = pags_plane(out, PAGS_SH + k);
    const ply_type type = rgb[k]->type;
    const double most = type == PLY_FLOAT || type == PLY_DOUBLE ? 1 : type == PLY_USHORT ? 65535 : 255;
    for (int64_t i = 0; i < out->count; i++)
      values[i] = (float)((pags_ply_value(table, vertex, rgb[k], i) / most - 0.5) / PAGS_SH_C0);
  }
}

/* The kinds of splats that other programs write with fewer properties than INRIA's: what is missing and how it is
 * taken. */
typedef struct reduced {
  bool flat;                  /* no scale_2: 2D Gaussian splats, discs */
  bool round;                 /* scale_0 alone: round Gaussians */
  bool solid;                 /* no opacity: opaque */
  bool turned;                /* rot_0 to rot_3 are there */
  const ply_property *rgb[3]; /* in place of f_dc_*; NULL: f_dc_* are there */
} reduced;

/* Finds the kind of the file; fails, naming the missing property, if it is none of them. */
static pags_result find_reduced(const ply_table *table, const ply_element *vertex, reduced *kind) {
  static const char *const rgb_names[3] = {"red", "green", "blue"};
  static const char *const must[] = {"x", "y", "z", "scale_0"};
  for (int i = 0; i < 4; i++)
    if (!pags_ply_property_find(table, vertex, must[i]))
      return pags_fail(
          PAGS_ERROR_FORMAT, "%s: no property '%s' in element 'vertex': not a 3D Gaussian splat%s", table->path,
          must[i],
          i == 3 ? " but points, which only a training can start from (ply_file_path of a transforms.json)" : "");
  kind->round = !pags_ply_property_find(table, vertex, "scale_1");
  kind->flat = !kind->round && !pags_ply_property_find(table, vertex, "scale_2");
  kind->solid = !pags_ply_property_find(table, vertex, "opacity");
  kind->turned = pags_ply_property_find(table, vertex, "rot_0") != NULL;
  if (!pags_ply_property_find(table, vertex, "f_dc_0"))
    for (int k = 0; k < 3; k++) {
      kind->rgb[k] = pags_ply_property_find(table, vertex, rgb_names[k]);
      if (!kind->rgb[k])
        return pags_fail(PAGS_ERROR_FORMAT,
                         "%s: neither 'f_dc_0' nor '%s' in element 'vertex': Gaussians without colour", table->path,
                         rgb_names[k]);
    }
  return PAGS_OK;
}

/* Fills the properties that a reduced kind lacks and logs them. */
static void complete(const ply_table *table, const ply_element *vertex, const reduced *kind, pags_gaussians *out) {
  if (out->count == 0) /* has no planes */
    return;
  if (kind->rgb[0])
    read_rgb(table, vertex, kind->rgb, out);
  if (kind->flat) {
    fill(out, PAGS_SCALE + 2, PAGS_LEAST_SCALE);
    pags_log_message(PAGS_LOG_INFO, "%s: 2D Gaussian splats (no scale_2), taken as flat discs", table->path);
  }
  for (int k = 1; k < 3 && kind->round; k++)
    memcpy(pags_plane(out, PAGS_SCALE + k), pags_plane(out, PAGS_SCALE), (size_t)out->count * sizeof(float));
  if (kind->round)
    pags_log_message(PAGS_LOG_WARNING, "%s: scale_0 alone: its %lld Gaussians are taken as round", table->path,
                     (long long)out->count);
  if (!kind->turned) {
    fill(out, PAGS_ROTATION, 1);
    for (int k = 1; k < 4; k++)
      fill(out, PAGS_ROTATION + k, 0);
    if (!kind->round)
      pags_log_message(PAGS_LOG_WARNING, "%s: no rot_0: its %lld Gaussians are taken as not rotated", table->path,
                       (long long)out->count);
  }
  if (kind->solid) {
    fill(out, PAGS_OPACITY, PAGS_MOST_OPACITY);
    pags_log_message(PAGS_LOG_WARNING, "%s: no opacity: its %lld Gaussians are taken as opaque", table->path,
                     (long long)out->count);
  }
}

/* Whether a kind of splats has no property for a plane. */
static bool lacks(const reduced *kind, int plane) {
  return (kind->rgb[0] && plane >= PAGS_SH && plane < PAGS_SH + 3) || (kind->solid && plane == PAGS_OPACITY) ||
         (kind->flat && plane == PAGS_SCALE + 2) || (kind->round && plane > PAGS_SCALE && plane < PAGS_SCALE + 3) ||
         (!kind->turned && plane >= PAGS_ROTATION && plane < PAGS_ROTATION + 4);
}

/* Reads the semantic priority, if the file has it; values outside of 0..1 are an error. */
static pags_result read_s_sem(const ply_table *table, const ply_element *vertex, pags_gaussians *out) {
  const ply_property *s_sem = pags_ply_property_find(table, vertex, "s_sem");
  if (!s_sem)
    return PAGS_OK;
  PAGS_TRY(pags_gaussians_add_s_sem(out));
  pags_ply_column(table, vertex, s_sem, 0, 0, out->count, out->s_sem);
  for (int64_t i = 0; i < out->count; i++)
    if (!(out->s_sem[i] >= 0 && out->s_sem[i] <= 1))
      return pags_fail(PAGS_ERROR_FORMAT, "%s: vertex %lld: expected 's_sem' from 0 to 1, found %g", table->path,
                       (long long)i, (double)out->s_sem[i]);
  return PAGS_OK;
}

static pags_result read_object_id(const ply_table *table, const ply_element *vertex, pags_gaussians *out) {
  const ply_property *object_id = pags_ply_property_find(table, vertex, "object_id");
  if (!object_id)
    return PAGS_OK;
  PAGS_TRY(pags_gaussians_add_object_id(out));
  for (int64_t i = 0; i < out->count; i++) {
    double id = pags_ply_value(table, vertex, object_id, i);
    if (!(id >= -1 && id <= INT32_MAX))
      return pags_fail(PAGS_ERROR_FORMAT, "%s: vertex %lld: expected 'object_id' from -1 to 2147483647, found %g",
                       table->path, (long long)i, id);
    out->object_id[i] = (int32_t)id;
  }
  return PAGS_OK;
}

/* Writes the property name of a Fourier plane: f_dc_tK_C for term K (1..4) and channel C (0..2). */
static void name_fourier(int plane, char name[NAME_SIZE]) {
  snprintf(name, NAME_SIZE, "f_dc_t%d_%d", 1 + plane / 3, plane % 3);
}

/* Reads the Fourier terms of the colour. A file must have all twelve properties or none. */
static pags_result read_fourier(const ply_table *table, const ply_element *vertex, pags_gaussians *out) {
  const ply_property *properties[FOURIER_PLANES];
  char names[FOURIER_PLANES][NAME_SIZE];
  int found = 0, missing = 0;
  for (int p = 0; p < FOURIER_PLANES; p++) {
    name_fourier(p, names[p]);
    properties[p] = pags_ply_property_find(table, vertex, names[p]);
    found += properties[p] != NULL;
    missing = properties[p] ? missing : p;
  }
  if (found == 0)
    return PAGS_OK;
  if (found < FOURIER_PLANES)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected all of 'f_dc_t1_0' to 'f_dc_t4_2' or none, no '%s'", table->path,
                     names[missing]);
  PAGS_TRY(pags_gaussians_add_fourier(out));
  for (int p = 0; p < FOURIER_PLANES && out->count; p++)
    pags_ply_column(table, vertex, properties[p], 0, 0, out->count, out->fourier + p * out->stride);
  return PAGS_OK;
}

/* Reads the elements' Gaussians. Positions of a higher precision than floats have may get an origin
 * (scene/splat_formats.h). */
static pags_result read_vertices(const ply_table *table, const ply_element *vertex, pags_gaussians *out,
                                 double origin[3]) {
  column columns[MAX_COLUMNS];
  const ply_property *properties[MAX_COLUMNS];
  reduced kind = {0};
  int stored;
  PAGS_TRY(find_degree(table, vertex, &stored));
  PAGS_TRY(find_reduced(table, vertex, &kind));
  const int degree = stored > 3 ? 3 : stored;
  int count = list_columns(degree, columns);
  const int rest = pags_sh_coefficients(degree) - 1, stored_rest = pags_sh_coefficients(stored) - 1;

  /* Finds the property of each column; only normals and those that the kind lacks may be missing. */
  for (int i = 0; i < count; i++) {
    char other[NAME_SIZE];
    const char *name = columns[i].name;
    const int plane = columns[i].plane, harmonic = (plane - PAGS_SH) / 3 - 1, channel = (plane - PAGS_SH) % 3;
    if (plane >= PAGS_SH + 3 && stored_rest != rest) { /* f_rest is channel-major: other degrees have other numbers */
      snprintf(other, sizeof other, "f_rest_%d", channel * stored_rest + harmonic);
      name = other;
    }
    properties[i] = plane < 0 || lacks(&kind, plane) ? NULL : pags_ply_property_find(table, vertex, name);
    if (!properties[i] && plane >= 0 && !lacks(&kind, plane))
      return pags_fail(PAGS_ERROR_FORMAT, "%s: no property '%s' in element 'vertex': not a 3D Gaussian splat",
                       table->path, name);
  }

  PAGS_TRY(pags_ply_table_need(table, vertex));
  PAGS_TRY(pags_gaussians_create(out, vertex->count, degree));
  for (int k = 0; k < 3 && out->count; k++)
    if (properties[k]->type != PLY_FLOAT)
      origin[k] = pags_ply_origin(table, vertex, properties[k]);
  for (int64_t first = 0; first < out->count; first += BLOCK_ROWS) {
    const int64_t rows = out->count - first < BLOCK_ROWS ? out->count - first : BLOCK_ROWS;
    for (int i = 0; i < count; i++)
      if (properties[i])
        pags_ply_column(table, vertex, properties[i], i < 3 ? origin[i] : 0, first, rows,
                        pags_plane(out, columns[i].plane) + first);
  }
  complete(table, vertex, &kind, out);
  if (stored > 3)
    pags_log_message(PAGS_LOG_WARNING, "%s: spherical harmonics of degree 4 are dropped, degrees 0 to 3 kept",
                     table->path);
  PAGS_TRY(read_s_sem(table, vertex, out));
  PAGS_TRY(read_object_id(table, vertex, out));
  return read_fourier(table, vertex, out);
}

pags_result pags_ply_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts) {
  ply_table table;
  *out = (pags_gaussians){0};
  PAGS_TRY(pags_ply_table_open(&table, path, bytes, size));
  const ply_element *vertex = pags_ply_table_find(&table, "vertex");
  bool compressed = vertex && pags_ply_property_find(&table, vertex, "packed_position");
  pags_result result;
  if (!vertex)
    result = pags_fail(PAGS_ERROR_FORMAT, "%s: expected an element 'vertex'", path);
  else if (compressed)
    result = pags_compressed_ply_decode(&table, out, table.facts.taken_off);
  else
    result = read_vertices(&table, vertex, out, table.facts.taken_off);
  out->alpha_min = table.alpha_min;
  *facts = table.facts;
  for (int k = 0; k < 3; k++)
    facts->origin[k] += facts->taken_off[k];
  facts->kind = compressed ? "compressed PLY" : "PLY";
  pags_ply_table_close(&table);
  const int64_t count = out->count;
  if (result == PAGS_OK)
    result = pags_splat_accept(path, out);
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  facts->left_out = count - out->count;
  return result;
}

pags_result pags_ply_load(const char *path, pags_gaussians *out) {
  uint8_t *bytes;
  size_t size;
  pags_splat_facts facts;
  *out = (pags_gaussians){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  pags_result result = size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r')
                           ? pags_ply_decode(path, bytes, size, out, &facts)
                           : pags_fail(PAGS_ERROR_FORMAT, "%s: expected a PLY file, which begins with 'ply'", path);
  if (result == PAGS_OK)
    pags_large_put_back(out, facts.taken_off);
  free(bytes);
  return result;
}

/* ---- Writing ---- */

/* Stores `rows` floats `stride` bytes apart, little-endian; zeros if `values` is NULL. */
static void pack_floats(const float *values, int64_t rows, size_t stride, uint8_t *out) {
  for (int64_t row = 0; row < rows; ++row, out += stride)
    pags_store_f32(out, values ? values[row] : 0.0f);
}

int pags_ply_row_bytes(const pags_gaussians *g) {
  return 4 * (pags_plane_count(g->sh_degree) + NORMALS + (g->s_sem != NULL) + (g->object_id != NULL) +
              (g->fourier ? FOURIER_PLANES : 0));
}

/* Writes the comments that parse_comment of ply_table.c reads. Returns the length. */
static int put_facts(const pags_splat_facts *facts, char *text, size_t size) {
  int length = 0;
  if (facts->antialiased)
    length += snprintf(text, size, "comment SplatRenderMode: mip\n");
  if (facts->up == PAGS_UP_Z || facts->up == PAGS_UP_Y) /* -y is the default of readers */
    length += snprintf(text + length, size - (size_t)length, "comment Vertical axis: %s\n",
                       facts->up == PAGS_UP_Z ? "z" : "0 1 0");
  if (facts->origin[0] != 0 || facts->origin[1] != 0 || facts->origin[2] != 0) {
    char number[3][PAGS_DOUBLE_TEXT];
    for (int k = 0; k < 3; k++)
      pags_text_from_double(facts->origin[k], number[k]);
    length +=
        snprintf(text + length, size - (size_t)length, "comment offset %s %s %s\n", number[0], number[1], number[2]);
  }
  if (facts->converted_from > 0.0f)
    length += snprintf(text + length, size - (size_t)length, "comment converted_from_alpha_min %.9g\n",
                       (double)facts->converted_from);
  return length;
}

pags_result pags_ply_check_name(const char *path) {
  static const char ending[] = ".compressed.ply";
  const size_t length = strlen(path), end = sizeof ending - 1;
  if (length < end || strcasecmp(path + length - end, ending) != 0)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_ARGUMENT,
                   "%s: other programs take this name for PlayCanvas's compressed PLY, which isn't written: expected "
                   "another name ending in .ply, or .sog or .spz for a small file",
                   path);
}

pags_result pags_ply_save(const char *path, const pags_gaussians *gaussians) {
  return pags_ply_save_facts(path, gaussians, NULL);
}

pags_result pags_ply_save_facts(const char *path, const pags_gaussians *gaussians, const pags_splat_facts *facts) {
  column columns[MAX_COLUMNS];
  int count = list_columns(gaussians->sh_degree, columns);
  size_t stride = (size_t)pags_ply_row_bytes(gaussians);
  uint8_t *block = malloc(stride * BLOCK_ROWS);
  if (!block)
    return pags_out_of_memory("%s", path);
  pags_file_writer writer;
  pags_result result = pags_file_writer_begin(&writer, path);
  if (result == PAGS_OK) {
    char text[(MAX_COLUMNS + FOURIER_PLANES) * 32 + 512], name[NAME_SIZE];
    int length = snprintf(text, sizeof text, "ply\nformat binary_little_endian 1.0\n");
    if (facts)
      length += put_facts(facts, text + length, sizeof text - (size_t)length);
    if (gaussians->alpha_min > 0.0f)
      length += snprintf(text + length, sizeof text - (size_t)length, "comment alpha_min %.9g\n",
                         (double)gaussians->alpha_min);
    length +=
        snprintf(text + length, sizeof text - (size_t)length, "element vertex %lld\n", (long long)gaussians->count);
    for (int i = 0; i < count; i++)
      length += snprintf(text + length, sizeof text - (size_t)length, "property float %s\n", columns[i].name);
    length +=
        snprintf(text + length, sizeof text - (size_t)length, "%s%s", gaussians->s_sem ? "property float s_sem\n" : "",
                 gaussians->object_id ? "property int object_id\n" : "");
    for (int p = 0; p < FOURIER_PLANES && gaussians->fourier; p++) {
      name_fourier(p, name);
      length += snprintf(text + length, sizeof text - (size_t)length, "property float %s\n", name);
    }
    length += snprintf(text + length, sizeof text - (size_t)length, "end_header\n");
    result = pags_file_writer_put(&writer, text, (size_t)length);
  }
  for (int64_t first = 0; first < gaussians->count && result == PAGS_OK; first += BLOCK_ROWS) {
    int64_t rows = gaussians->count - first < BLOCK_ROWS ? gaussians->count - first : BLOCK_ROWS;

    /* Builds rows [first, first + rows) in the file's order, column by column, so that each plane is read in one
     * run. */
    uint8_t *out = block;
    for (int i = 0; i < count; ++i, out += 4)
      pack_floats(columns[i].plane < 0 ? NULL : pags_plane(gaussians, columns[i].plane) + first, rows, stride, out);
    if (gaussians->s_sem) {
      pack_floats(gaussians->s_sem + first, rows, stride, out);
      out += 4;
    }
    if (gaussians->object_id) {
      for (int64_t row = 0; row < rows; row++)
        pags_store_u32(out + (size_t)row * stride, (uint32_t)gaussians->object_id[first + row]);
      out += 4;
    }
    for (int p = 0; p < FOURIER_PLANES && gaussians->fourier; ++p, out += 4)
      pack_floats(gaussians->fourier + p * gaussians->stride + first, rows, stride, out);

    result = pags_file_writer_put(&writer, block, stride * (size_t)rows);
  }
  if (result == PAGS_OK)
    result = pags_file_writer_commit(&writer);
  free(block);
  return result;
}
