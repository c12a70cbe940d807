/* SPDX-License-Identifier: Apache-2.0 */
/* Reads the point cloud of a PLY file (ascii or binary little-endian): x y z and red green blue of the vertices;
 * other scalar properties are skipped. PLY files of splats have a reader of their own in scene/. */
#include "dataset/parsed.h"

#include "base/file.h"
#include "base/text.h"

#include <stdlib.h>
#include <string.h>

enum { MAX_PROPERTIES = 128, WANTED = 6 };

typedef enum scalar { I8, U8, I16, U16, I32, U32, F32, F64, SCALARS } scalar;

static const size_t scalar_bytes[SCALARS] = {1, 1, 2, 2, 4, 4, 4, 8};

typedef struct ply {
  const char *path;
  const char *at, *end;
  int line;
  bool ascii;
  int64_t count;
  int properties;
  scalar types[MAX_PROPERTIES];
  int wanted[WANTED]; /* index of the property x y z red green blue; -1: not in the file */
} ply;

static pags_result fail(const ply *p, const char *expected) {
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s", p->path, p->line, expected);
}

/* Copies the next line of the header, without its line end, to `line`. */
static pags_result next_line(ply *p, char line[256]) {
  const char *stop = memchr(p->at, '\n', (size_t)(p->end - p->at));
  p->line++;
  if (!stop || stop - p->at >= 255)
    return fail(p, "a line of a PLY header");
  size_t length = (size_t)(stop - p->at);
  memcpy(line, p->at, length);
  line[length] = '\0';
  if (length && line[length - 1] == '\r')
    line[length - 1] = '\0';
  p->at = stop + 1;
  return PAGS_OK;
}

static bool scalar_of(const char *name, scalar *out) {
  static const char *const names[2][SCALARS] = {
      {"char", "uchar", "short", "ushort", "int", "uint", "float", "double"},
      {"int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"}};
  for (int i = 0; i < SCALARS; i++)
    if (strcmp(name, names[0][i]) == 0 || strcmp(name, names[1][i]) == 0) {
      *out = (scalar)i;
      return true;
    }
  return false;
}

static pags_result add_property(ply *p, const char *type, const char *name) {
  static const char *const names[WANTED] = {"x", "y", "z", "red", "green", "blue"};
  if (p->properties == MAX_PROPERTIES)
    return fail(p, "at most 128 properties");
  if (!name || !scalar_of(type, &p->types[p->properties]))
    return fail(p, "a scalar property of the vertices");
  for (int i = 0; i < WANTED; i++)
    if (strcmp(name, names[i]) == 0)
      p->wanted[i] = p->properties;
  p->properties++;
  return PAGS_OK;
}

static pags_result read_format(ply *p) {
  char line[256];
  PAGS_TRY(next_line(p, line));
  if (strcmp(line, "ply") != 0)
    return fail(p, "'ply'");
  PAGS_TRY(next_line(p, line));
  p->ascii = strcmp(line, "format ascii 1.0") == 0;
  return p->ascii || strcmp(line, "format binary_little_endian 1.0") == 0
             ? PAGS_OK
             : fail(p, "'format ascii 1.0' or 'format binary_little_endian 1.0'");
}

/* Cuts the next word off `*rest`; NULL at the end. */
static char *next_word(char **rest) {
  char *const word = *rest + strspn(*rest, " ");
  *rest = word + strcspn(word, " ");
  if (**rest)
    *(*rest)++ = 0;
  return *word ? word : NULL;
}

static pags_result read_header(ply *p) {
  char line[256];
  bool in_vertex = false, seen_vertex = false;
  PAGS_TRY(read_format(p));
  for (;;) {
    PAGS_TRY(next_line(p, line));
    char *rest = line, *word = next_word(&rest);
    if (!word || strcmp(word, "comment") == 0 || strcmp(word, "obj_info") == 0)
      continue;
    char *second = next_word(&rest), *third = next_word(&rest);
    if (strcmp(word, "end_header") == 0)
      break;
    if (strcmp(word, "element") == 0 && second && third) {
      in_vertex = strcmp(second, "vertex") == 0;
      if (!in_vertex && !seen_vertex)
        return fail(p, "the vertices to come first");
      if (in_vertex)
        p->count = strtoll(third, NULL, 10);
      seen_vertex = true;
    } else if (strcmp(word, "property") == 0 && second) {
      if (in_vertex)
        PAGS_TRY(add_property(p, second, third));
    } else {
      return fail(p, "'element', 'property' or 'end_header'");
    }
  }
  if (!seen_vertex || p->wanted[0] < 0 || p->wanted[1] < 0 || p->wanted[2] < 0)
    return fail(p, "vertices with x, y and z");
  /* A row has at least two bytes per property as text ("0 ") and one as binary, so that a larger count can't be
   * true. */
  if (p->count < 0 || p->count > (p->end - p->at) / p->properties)
    return fail(p, "no more vertices than the file has room for");
  return PAGS_OK;
}

static double get_binary(const char *at, scalar type) {
  union {
    int8_t i8;
    uint8_t u8;
    int16_t i16;
    uint16_t u16;
    int32_t i32;
    uint32_t u32;
    float f32;
    double f64;
  } value;
  memcpy(&value, at, scalar_bytes[type]);
  switch (type) {
    case I8: return value.i8;
    case U8: return value.u8;
    case I16: return value.i16;
    case U16: return value.u16;
    case I32: return value.i32;
    case U32: return value.u32;
    case F32: return (double)value.f32;
    default: return value.f64;
  }
}

static pags_result read_row(ply *p, double values[MAX_PROPERTIES]) {
  for (int i = 0; i < p->properties; i++) {
    char *after = NULL;
    if (p->ascii) {
      values[i] = pags_text_to_double(p->at, &after);
      if (after == p->at)
        return fail(p, "a number in every property of a vertex");
      p->at = after;
    } else {
      if ((size_t)(p->end - p->at) < scalar_bytes[p->types[i]])
        return pags_fail(PAGS_ERROR_FORMAT, "%s: ends within its vertices", p->path);
      values[i] = get_binary(p->at, p->types[i]);
      p->at += scalar_bytes[p->types[i]];
    }
  }
  p->line++;
  return PAGS_OK;
}

/* Converts a colour to a byte. 16-bit unsigned integers hold 0..65535, all other integers 0..255, floats 0..1. */
static uint8_t colour_of(double value, scalar type) {
  double unit = type == F32 || type == F64 ? value * 255 : type == U16 ? value / 257 : value;
  return (uint8_t)(unit > 0 ? (unit < 255 ? unit + 0.5 : 255) : 0);
}

static pags_result read_points(ply *p, pags_parsed_points *points) {
  for (int64_t i = 0; i < p->count; i++) {
    double values[MAX_PROPERTIES], xyz[3];
    uint8_t rgb[3];
    PAGS_TRY(read_row(p, values));
    for (int c = 0; c < 3; c++) {
      int colour = p->wanted[3 + c];
      xyz[c] = values[p->wanted[c]];
      rgb[c] = colour < 0 ? 128 : colour_of(values[colour], p->types[colour]);
    }
    PAGS_TRY(pags_parsed_add_point(points, i, xyz, rgb, p->path));
  }
  return PAGS_OK;
}

pags_result pags_ply_points_read(const char *path, pags_parsed_points *points) {
  uint8_t *bytes;
  size_t size;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  ply p = {.path = path, .at = (const char *)bytes, .end = (const char *)bytes + size};
  for (int i = 0; i < WANTED; i++)
    p.wanted[i] = -1;
  pags_result result = read_header(&p);
  if (result == PAGS_OK)
    result = read_points(&p, points);
  free(bytes);
  return result;
}
