/* SPDX-License-Identifier: Apache-2.0 */
/* Reads and writes the PLY files of INRIA's 3D Gaussian splatting (Kerbl et al. 2023): properties are found by name
 * in any order and written in INRIA's order, with the optional s_sem, object_id and Fourier terms after them.
 *
 * f_rest is channel-major in the file (all of R, then G, then B) and coefficient-major in memory. Values are not
 * changed, so that reading and writing gives the same bytes. Normals are not read; they are written as zeros. */
#include <stdarg.h>
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
#include "base/vec3.h"
#include "scene/splat_formats.h"

enum { NORMALS = 3, BLOCK_ROWS = 256, NAME_SIZE = 24 };
enum { MAX_COLUMNS = PAGS_MAX_PLANES + NORMALS + PAGS_MAX_FOURIER + 2 };

/* ---- Columns ---- */

/* A column of the file: the name of its property and its values in memory. */
typedef struct column {
  char name[NAME_SIZE];
  int plane;          /* the plane with the values; -1: a normal, or none of the planes */
  const void *values; /* to write: a float or int32 for each row; NULL: zeros */
  bool whole;         /* integers */
} column;

/* Lists the columns of a file of SH degree `sh_degree` in INRIA's order. Returns their number. */
static int list_columns(int sh_degree, column columns[MAX_COLUMNS]) {
  enum { PLAIN = 17, BEFORE_REST = 9 };
  static const char *const names[PLAIN] = {"x",       "y",      "z",      "nx",      "ny",      "nz",
                                           "f_dc_0",  "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                                           "scale_2", "rot_0",  "rot_1",  "rot_2",   "rot_3"};
  static const int planes[PLAIN] = {0, 1, 2, -1, -1, -1, 11, 12, 13, 10, 3, 4, 5, 6, 7, 8, 9};
  const int rest = pags_sh_coefficients(sh_degree) - 1;
  int count = 0;
  for (int i = 0; i < PLAIN; i++) {
    for (int k = 0; k < 3 * rest && i == BEFORE_REST; k++) {
      columns[count] = (column){.plane = PAGS_SH + 3 * (1 + k % rest) + k / rest};
      snprintf(columns[count++].name, NAME_SIZE, "f_rest_%d", k);
    }
    columns[count] = (column){.plane = planes[i]};
    snprintf(columns[count++].name, NAME_SIZE, "%s", names[i]);
  }
  return count;
}

/* Writes the property name of a Fourier plane for term K (1..4) and channel C (0..2): f_dc_tK_C of the constant SH
 * coefficient, f_shN_tK_C of coefficient N (1..15). Other programs count the names that begin with f_rest_. */
static void name_fourier(int plane, char name[NAME_SIZE]) {
  const int coefficient = plane / PAGS_FOURIER_PLANES, term = 1 + plane % PAGS_FOURIER_PLANES / 3;
  if (coefficient == 0)
    snprintf(name, NAME_SIZE, "f_dc_t%d_%d", term, plane % 3);
  else
    snprintf(name, NAME_SIZE, "f_sh%d_t%d_%d", coefficient, term, plane % 3);
}

/* ---- Reading ---- */

/* The kinds of splats that other programs write with fewer properties than INRIA's: what is missing and how it is
 * taken. */
typedef struct reduced {
  bool flat;                  /* no scale_2: 2D Gaussian splats, discs */
  bool round;                 /* scale_0 alone: round Gaussians */
  bool solid;                 /* no opacity: opaque */
  bool turned;                /* rot_0 to rot_3 are there */
  const ply_property *rgb[3]; /* in place of f_dc_*; NULL: f_dc_* are there */
} reduced;

/* Finds the kind of the file; fails, naming the missing property, if the kind is not known. */
static pags_result find_reduced(const ply_table *table, const ply_element *vertex, reduced *kind) {
  static const char *const rgb_names[3] = {"red", "green", "blue"};
  static const char *const must[] = {"x", "y", "z", "scale_0"};
  for (int i = 0; i < 4; i++)
    if (!pags_ply_property_find(table, vertex, must[i]))
      return pags_fail_at(
          table->path, "no property '%s' in element 'vertex': not a 3D Gaussian splat%s", must[i],
          i == 3 ? " but points, which only a training can start from (ply_file_path of a transforms.json)" : "");
  kind->round = !pags_ply_property_find(table, vertex, "scale_1");
  kind->flat = !kind->round && !pags_ply_property_find(table, vertex, "scale_2");
  kind->solid = !pags_ply_property_find(table, vertex, "opacity");
  kind->turned = pags_ply_property_find(table, vertex, "rot_0");
  for (int k = 0; k < 3 && !pags_ply_property_find(table, vertex, "f_dc_0"); k++) {
    kind->rgb[k] = pags_ply_property_find(table, vertex, rgb_names[k]);
    if (!kind->rgb[k])
      return pags_fail_at(table->path, "neither 'f_dc_0' nor '%s' in element 'vertex': Gaussians without colour",
                          rgb_names[k]);
  }
  return PAGS_OK;
}

static void fill(pags_gaussians *g, int plane, float value) {
  for (int64_t i = 0; i < g->count; i++)
    pags_plane(g, plane)[i] = value;
}

/* Fills the properties that a reduced kind lacks and logs them. */
static void complete(const ply_table *table, const ply_element *vertex, const reduced *kind, pags_gaussians *out) {
  const long long count = out->count;
  if (count == 0) /* has no planes */
    return;
  /* Red, green, blue (nerfstudio's --ply-color-mode rgb) are the constant colour. Whole numbers are of the type's whole
   * range, others of 0 to 1. */
  for (int k = 0; k < 3 && kind->rgb[0]; k++) {
    const ply_type type = kind->rgb[k]->type;
    const double most = type == PLY_FLOAT || type == PLY_DOUBLE ? 1 : type == PLY_USHORT ? 65535 : 255;
    for (int64_t i = 0; i < count; i++)
      pags_plane(out, PAGS_SH + k)[i] =
          (float)((pags_ply_value(table, vertex, kind->rgb[k], i) / most - 0.5) / PAGS_SH_C0);
  }
  if (kind->flat) {
    fill(out, PAGS_SCALE + 2, PAGS_LEAST_SCALE);
    pags_log_message(PAGS_LOG_INFO, "%s: 2D Gaussian splats (no scale_2), taken as flat discs", table->path);
  }
  if (kind->round) {
    for (int k = 1; k < 3; k++)
      memcpy(pags_plane(out, PAGS_SCALE + k), pags_plane(out, PAGS_SCALE), (size_t)count * sizeof(float));
    PAGS_WARN("%s: scale_0 alone: its %lld Gaussians are taken as round", table->path, count);
  }
  if (!kind->turned)
    fill(out, PAGS_ROTATION, 1); /* the planes of x, y and z are zeros */
  if (!kind->turned && !kind->round)
    PAGS_WARN("%s: no rot_0: its %lld Gaussians are taken as not rotated", table->path, count);
  if (kind->solid) {
    fill(out, PAGS_OPACITY, PAGS_MOST_OPACITY);
    PAGS_WARN("%s: no opacity: its %lld Gaussians are taken as opaque", table->path, count);
  }
}

/* Whether a kind of splats has no property for a plane; -1, normals, are never read. */
static bool lacks(const reduced *kind, int plane) {
  return plane < 0 || (kind->rgb[0] && plane >= PAGS_SH && plane < PAGS_SH + 3) ||
         (kind->solid && plane == PAGS_OPACITY) || (kind->flat && plane == PAGS_SCALE + 2) ||
         (kind->round && plane > PAGS_SCALE && plane < PAGS_SCALE + 3) ||
         (!kind->turned && plane >= PAGS_ROTATION && plane < PAGS_ROTATION + 4);
}

/* Reads the semantic priority, the object's number and the Fourier terms of the colour, where the file has them; the
 * first two within their ranges, and of the terms all or none. */
static pags_result read_optional(const ply_table *table, const ply_element *vertex, pags_gaussians *out) {
  const ply_property *const s_sem = pags_ply_property_find(table, vertex, "s_sem");
  if (s_sem) {
    PAGS_TRY(pags_gaussians_add_s_sem(out));
    pags_ply_column(table, vertex, s_sem, 0, 0, out->count, out->s_sem);
  }
  for (int64_t i = 0; i < out->count && s_sem; i++)
    if (!(out->s_sem[i] >= 0 && out->s_sem[i] <= 1))
      return pags_fail_at(table->path, "vertex %lld: expected 's_sem' from 0 to 1, found %g", (long long)i,
                          (double)out->s_sem[i]);

  const ply_property *const object_id = pags_ply_property_find(table, vertex, "object_id");
  if (object_id)
    PAGS_TRY(pags_gaussians_add_object_id(out));
  for (int64_t i = 0; i < out->count && object_id; i++) {
    const double id = pags_ply_value(table, vertex, object_id, i);
    if (!(id >= -1 && id <= INT32_MAX))
      return pags_fail_at(table->path, "vertex %lld: expected 'object_id' from -1 to 2147483647, found %g",
                          (long long)i, id);
    out->object_id[i] = (int32_t)id;
  }

  /* The SH degree up to which coefficients have terms follows from the last term in the file. */
  const ply_property *terms[PAGS_MAX_FOURIER];
  char name[NAME_SIZE], last[NAME_SIZE];
  int degree = -1;
  for (int p = 0; p < PAGS_MAX_FOURIER; p++) {
    name_fourier(p, name);
    terms[p] = pags_ply_property_find(table, vertex, name);
    while (terms[p] && p >= (degree < 0 ? 0 : PAGS_FOURIER_PLANES * pags_sh_coefficients(degree)))
      degree++;
  }
  if (degree < 0)
    return PAGS_OK;
  if (degree > out->sh_degree)
    return pags_fail_at(table->path, "Fourier terms of SH degree %d, but SH degree %d", degree, out->sh_degree);
  const int planes = PAGS_FOURIER_PLANES * pags_sh_coefficients(degree);
  name_fourier(planes - 1, last);
  for (int p = 0; p < planes; p++) {
    name_fourier(p, name);
    if (!terms[p])
      return pags_fail_at(table->path, "expected all of 'f_dc_t1_0' to '%s' or none, no '%s'", last, name);
  }
  PAGS_TRY(pags_gaussians_add_fourier(out, degree));
  for (int p = 0; p < planes && out->count; p++)
    pags_ply_column(table, vertex, terms[p], 0, 0, out->count, out->fourier + p * out->stride);
  return PAGS_OK;
}

/* Reads the elements' Gaussians. Positions of a higher precision than floats have may get an origin
 * (scene/splat_formats.h). */
static pags_result read_vertices(const ply_table *table, const ply_element *vertex, pags_gaussians *out,
                                 double origin[3]) {
  column columns[MAX_COLUMNS];
  const ply_property *properties[MAX_COLUMNS];
  reduced kind = {0};
  int given = 0;
  for (int i = 0; i < vertex->property_count; i++)
    given += pags_text_starts(table->properties[vertex->first_property + i].name, "f_rest_");
  const int stored = pags_ply_degree(given), degree = stored > 3 ? 3 : stored;
  if (stored < 0)
    return pags_fail_at(table->path, "expected 0, 9, 24, 45 or 72 properties f_rest_*, found %d", given);
  PAGS_TRY(find_reduced(table, vertex, &kind));
  const int count = list_columns(degree, columns);

  /* Finds the property of each column; only those that the kind lacks may be missing. */
  for (int i = 0; i < count; i++) {
    const int plane = columns[i].plane, harmonic = (plane - PAGS_SH) / 3 - 1, channel = (plane - PAGS_SH) % 3;
    if (harmonic >= 0) /* f_rest is channel-major: other degrees have other numbers */
      snprintf(columns[i].name, NAME_SIZE, "f_rest_%d", channel * (given / 3) + harmonic);
    properties[i] = lacks(&kind, plane) ? NULL : pags_ply_property_find(table, vertex, columns[i].name);
    if (!properties[i] && !lacks(&kind, plane))
      return pags_fail_at(table->path, "no property '%s' in element 'vertex': not a 3D Gaussian splat",
                          columns[i].name);
  }

  PAGS_TRY(pags_ply_table_need(table, vertex));
  PAGS_TRY(pags_splat_create(table->path, vertex->count, stored, out));
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
  return read_optional(table, vertex, out);
}

pags_result pags_ply_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts) {
  PAGS_AUTO(pags_ply_table_close) ply_table table = {0};
  PAGS_TRY(pags_ply_table_open(&table, path, bytes, size));
  *facts = table.facts;
  const ply_element *vertex = pags_ply_table_find(&table, "vertex");
  if (!vertex)
    return pags_fail_at(path, "expected an element 'vertex'");
  const bool compressed = pags_ply_property_find(&table, vertex, "packed_position");
  facts->kind = compressed ? "compressed PLY" : "PLY";
  PAGS_TRY(compressed ? pags_compressed_ply_decode(&table, out, facts->taken_off)
                      : read_vertices(&table, vertex, out, facts->taken_off));
  out->alpha_min = table.alpha_min;
  pags_add3(facts->origin, facts->taken_off, facts->origin);
  return PAGS_OK;
}

pags_result pags_ply_load(const char *path, pags_gaussians *out) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  size_t size;
  pags_splat_facts facts = {0};
  *out = (pags_gaussians){0};
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  if (!pags_ply_is(bytes, size))
    return pags_fail_at(path, "expected a PLY file, which begins with 'ply'");
  PAGS_TRY(pags_splat_run(pags_ply_decode, path, bytes, size, out, &facts));
  pags_large_put_back(out, facts.taken_off);
  return PAGS_OK;
}

/* ---- Writing ---- */

int pags_ply_row_bytes(const pags_gaussians *g) {
  return 4 * (pags_plane_count(g->sh_degree) + NORMALS + (g->s_sem != NULL) + (g->object_id != NULL) +
              pags_fourier_planes(g));
}

/* Lists the columns of `g` with their values. */
static int list_values(const pags_gaussians *g, column columns[MAX_COLUMNS]) {
  int count = list_columns(g->sh_degree, columns);
  for (int i = 0; i < count; i++)
    columns[i].values = columns[i].plane < 0 ? NULL : pags_plane(g, columns[i].plane);
  if (g->s_sem)
    columns[count++] = (column){.name = "s_sem", .plane = -1, .values = g->s_sem};
  if (g->object_id)
    columns[count++] = (column){.name = "object_id", .plane = -1, .values = g->object_id, .whole = true};
  for (int p = 0; p < pags_fourier_planes(g); p++) {
    columns[count] = (column){.plane = -1, .values = g->fourier + p * g->stride};
    name_fourier(p, columns[count++].name);
  }
  return count;
}

static pags_result put(pags_file_writer *writer, const char *format, ...) PAGS_PRINTF(2, 3);
static pags_result put(pags_file_writer *writer, const char *format, ...) {
  char line[256];
  va_list arguments;
  va_start(arguments, format);
  const int length = vsnprintf(line, sizeof line, format, arguments);
  va_end(arguments);
  return pags_file_writer_put(writer, line, (size_t)length);
}

/* Writes the comments that parse_comment of ply_table.c reads. */
static pags_result put_facts(pags_file_writer *writer, const pags_splat_facts *facts) {
  if (facts->antialiased)
    PAGS_TRY(put(writer, "comment SplatRenderMode: mip\n"));
  if (facts->up == PAGS_UP_Z || facts->up == PAGS_UP_Y) /* -y is the default of readers */
    PAGS_TRY(put(writer, "comment Vertical axis: %s\n", facts->up == PAGS_UP_Z ? "z" : "0 1 0"));
  if (facts->origin[0] != 0 || facts->origin[1] != 0 || facts->origin[2] != 0) {
    char number[3][PAGS_DOUBLE_TEXT];
    for (int k = 0; k < 3; k++)
      pags_text_from_double(facts->origin[k], number[k]);
    PAGS_TRY(put(writer, "comment offset %s %s %s\n", number[0], number[1], number[2]));
  }
  if (facts->converted_from > 0.0f)
    PAGS_TRY(put(writer, "comment converted_from_alpha_min %.9g\n", (double)facts->converted_from));
  return PAGS_OK;
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
  const int count = list_values(gaussians, columns);
  const size_t stride = (size_t)pags_ply_row_bytes(gaussians);
  PAGS_AUTOFREE uint8_t *block = malloc(stride * BLOCK_ROWS);
  PAGS_CHECK_MEMORY(block, "%s", path);
  pags_file_writer writer;
  PAGS_TRY(pags_file_writer_begin(&writer, path));
  PAGS_TRY(put(&writer, "ply\nformat binary_little_endian 1.0\n"));
  if (facts)
    PAGS_TRY(put_facts(&writer, facts));
  if (gaussians->alpha_min > 0.0f)
    PAGS_TRY(put(&writer, "comment alpha_min %.9g\n", (double)gaussians->alpha_min));
  PAGS_TRY(put(&writer, "element vertex %lld\n", (long long)gaussians->count));
  for (int i = 0; i < count; i++)
    PAGS_TRY(put(&writer, "property %s %s\n", columns[i].whole ? "int" : "float", columns[i].name));
  PAGS_TRY(put(&writer, "end_header\n"));
  for (int64_t first = 0; first < gaussians->count; first += BLOCK_ROWS) {
    const int64_t rows = gaussians->count - first < BLOCK_ROWS ? gaussians->count - first : BLOCK_ROWS;
    /* Column by column, so that each plane is read in one run. */
    for (int i = 0; i < count; i++)
      for (int64_t row = 0; row < rows; row++) {
        uint32_t word = 0;
        if (columns[i].values)
          memcpy(&word, (const uint8_t *)columns[i].values + 4 * (first + row), sizeof word);
        pags_store_u32(block + (size_t)row * stride + 4 * i, word);
      }
    PAGS_TRY(pags_file_writer_put(&writer, block, stride * (size_t)rows));
  }
  return pags_file_writer_commit(&writer);
}
