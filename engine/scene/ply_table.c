/* SPDX-License-Identifier: Apache-2.0 */
/* Parses PLY files (Turk 1994): a text header of elements and properties, then the rows of each element as text or as
 * binary numbers of either byte order. Rows of text are converted to little-endian binary. */
#include "scene/ply_table.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/splat_formats.h"

/* Two names of each ply_type. */
enum { TYPE_NAMES = 16 };
static const char *const type_names[TYPE_NAMES] = {"char",   "int8",    "uchar",  "uint8",  "short", "int16",
                                                   "ushort", "uint16",  "int",    "int32",  "uint",  "uint32",
                                                   "float",  "float32", "double", "float64"};
static const int type_sizes[] = {1, 1, 2, 2, 4, 4, 4, 8};

enum { MAX_PROPERTIES = 4096, MAX_WORDS = 6 };

/* ---- Reading the header ---- */

/* Cuts a header line into words at blanks and tabs, in place. Returns their number, at most MAX_WORDS; the last of
 * that many holds the whole rest of the line. */
static int split(char *line, char *words[MAX_WORDS]) {
  int count = 0;
  while (count < MAX_WORDS) {
    line += strspn(line, " \t");
    if (!*line)
      break;
    words[count++] = line;
    line += strcspn(line, " \t");
    if (*line && count < MAX_WORDS)
      *line++ = 0;
  }
  return count;
}

/* Parses a line "property TYPE NAME" and appends the property to the last element. */
static pags_result parse_property(ply_table *t, int line, int words, char *word[]) {
  if (t->element_count == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: a property before any element", t->path, line);
  ply_element *element = &t->elements[t->element_count - 1];
  if (words == 5 && strcmp(word[1], "list") == 0) {
    element->has_list = true;
    return PAGS_OK;
  }
  const int named = words == 3 ? pags_text_find(word[1], type_names, TYPE_NAMES) : -1;
  if (named < 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected 'property', a type and a name", t->path, line);

  /* Appends the property at the end of the element's row. */
  if (t->property_count == MAX_PROPERTIES)
    return pags_fail(PAGS_ERROR_LIMIT, "%s:%d: more than %d properties", t->path, line, MAX_PROPERTIES);
  if (pags_ply_property_find(t, element, word[2]))
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: a second property '%s'", t->path, line, word[2]);
  PAGS_CHECK_MEMORY(pags_grow(&t->properties, t->property_count + 1, &t->property_capacity, sizeof *t->properties),
                    "%s:%d: the header", t->path, line);
  const bool position = word[2][0] && strchr("xyz", word[2][0]) && !word[2][1];
  ply_type type = (ply_type)(named / 2);
  if (t->ascii && type == PLY_FLOAT && position) /* text has all the digits that were written */
    type = PLY_DOUBLE;
  t->properties[t->property_count++] = (ply_property){word[2], type, element->stride};
  element->property_count++;
  element->stride += type_sizes[type];
  return PAGS_OK;
}

/* Reads `count` finite numbers, each a word of its own; returns false if there is another word among them. */
static bool parse_numbers(char *word[], int count, double *out) {
  for (int k = 0; k < count; k++) {
    char *end;
    out[k] = pags_text_to_double(word[k], &end);
    if (end == word[k] || end[strspn(end, " \t")] || !isfinite(out[k]))
      return false;
  }
  return true;
}

/* "Vertical axis: z" of nerfstudio and PAGS, or, of Brush and PAGS, a direction along an axis: "0 1 0". Brush writes y
 * where it knows nothing: whether that is up or down isn't said. */
static void parse_vertical_axis(const char *path, int words, char *value[], pags_splat_facts *facts) {
  double up[3];
  if (words == 1 && strcasecmp(value[0], "z") == 0)
    facts->up = PAGS_UP_Z;
  if (words != 3 || !parse_numbers(value, 3, up))
    return;
  if (up[0] == 0 && up[1] == 0 && up[2] > 0)
    facts->up = PAGS_UP_Z;
  else if (up[0] == 0 && up[1] != 0 && up[2] == 0)
    facts->up = up[1] > 0 ? PAGS_UP_Y : PAGS_UP_MINUS_Y;
  else
    PAGS_WARN("%s: its vertical axis, %g %g %g, isn't z, y or -y and is not used", path, up[0], up[1], up[2]);
}

/* Reads the metadata that programs write as comments, in any case, with or without a colon: "SplatRenderMode: mip"
 * (Brush, gsplat, splat-transform, PAGS), "antialiased 1" (Postshot), "train_flags antialiasing" (proposed to INRIA);
 * "Vertical axis"; "offset X Y Z", which was taken off all positions; "alpha_min A" and "converted_from_alpha_min A"
 * (pags_gaussians, pags_splat_facts; PAGS). Others are skipped; of several the last holds. */
static void parse_comment(ply_table *t, int words, char *word[]) {
  pags_splat_facts *const facts = &t->facts;
  double offset[3];
  if (words < 3)
    return;
  for (int i = 1; i <= 2; i++) {
    const size_t length = strlen(word[i]);
    if (length && word[i][length - 1] == ':')
      word[i][length - 1] = 0;
  }
  const char *const key = word[1], *const value = word[2];
  if (strcasecmp(key, "SplatRenderMode") == 0)
    facts->antialiased = strcasecmp(value, "mip") == 0;
  else if (strcasecmp(key, "antialiased") == 0)
    facts->antialiased = strcmp(value, "1") == 0 || strcasecmp(value, "true") == 0;
  else if (strcasecmp(key, "train_flags") == 0)
    facts->antialiased = strncasecmp(value, "antialias", 9) == 0;
  else if (strcasecmp(key, "Vertical") == 0 && strcasecmp(value, "axis") == 0)
    parse_vertical_axis(t->path, words - 3, word + 3, facts);
  else if (strcasecmp(key, "alpha_min") == 0 && parse_numbers(word + 2, 1, offset)) {
    const bool sound = offset[0] >= (double)PAGS_LEAST_ALPHA_MIN && offset[0] < 1;
    t->alpha_min = sound ? (float)offset[0] : 0.0f;
    if (!sound)
      PAGS_WARN("%s: its alpha_min, %g, isn't from 1/255 to 1 and is not used", t->path, offset[0]);
  } else if (strcasecmp(key, "converted_from_alpha_min") == 0 && parse_numbers(word + 2, 1, offset))
    facts->converted_from = (float)offset[0];
  else if (strcasecmp(key, "offset") == 0 && words == 5 && parse_numbers(word + 2, 3, offset))
    memcpy(facts->origin, offset, sizeof offset);
}

/* Parses one line of the header. */
static pags_result parse_line(ply_table *t, int line, char *text) {
  char *word[MAX_WORDS] = {0};
  int words = split(text, word);
  if (words && strcmp(word[0], "comment") == 0)
    parse_comment(t, words, word);
  if (words == 0 || strcmp(word[0], "comment") == 0 || strcmp(word[0], "obj_info") == 0)
    return PAGS_OK;
  if (strcmp(word[0], "format") == 0) {
    if (words < 3 || strcmp(word[2], "1.0") != 0)
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a format of version 1.0", t->path, line);
    t->ascii = strcmp(word[1], "ascii") == 0;
    t->big_endian = strcmp(word[1], "binary_big_endian") == 0;
    if (!t->ascii && !t->big_endian && strcmp(word[1], "binary_little_endian") != 0)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s:%d: expected ascii, binary_little_endian or binary_big_endian, found '%s'", t->path, line,
                       word[1]);
    return PAGS_OK;
  }
  if (strcmp(word[0], "element") == 0) {
    if (t->element_count == PLY_MAX_ELEMENTS)
      return pags_fail(PAGS_ERROR_LIMIT, "%s:%d: more than %d elements", t->path, line, PLY_MAX_ELEMENTS);
    char *end = NULL;
    errno = 0;
    long long count = words == 3 ? strtoll(word[2], &end, 10) : -1;
    if (words != 3 || *end || errno || count < 0)
      return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected 'element', a name and a count of rows", t->path, line);
    t->elements[t->element_count++] =
        (ply_element){.name = word[1], .count = count, .first_property = t->property_count};
    return PAGS_OK;
  }
  if (strcmp(word[0], "property") == 0)
    return parse_property(t, line, words, word);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected format, element, property, comment or end_header, found '%.40s'",
                   t->path, line, word[0]);
}

/* Returns the length of the header in bytes, including the line break after "end_header"; 0 if there is no such
 * line. */
static size_t header_length(const uint8_t *bytes, size_t size) {
  static const char mark[] = "end_header"; /* some programs put blanks behind it */
  size_t mark_length = sizeof mark - 1;
  for (size_t at = 0; at < size;) {
    const uint8_t *line_end = memchr(bytes + at, '\n', size - at);
    if (!line_end)
      return 0;
    size_t next = (size_t)(line_end - bytes) + 1, length = next - 1 - at;
    while (length > mark_length && strchr("\r\t ", bytes[at + length - 1]))
      length--;
    if (length == mark_length && memcmp(bytes + at, mark, mark_length) == 0)
      return next;
    at = next;
  }
  return 0;
}

/* Copies the header of `length` bytes, cuts it into lines and parses them. Fails if no line gives the format. */
static pags_result parse_header(ply_table *t, size_t length) {
  t->header = malloc(length + 1);
  PAGS_CHECK_MEMORY(t->header, "%s: the header", t->path);
  memcpy(t->header, t->bytes, length);
  t->header[length] = 0;
  bool has_format = false;
  int line = 1;
  if (memchr(t->header, 0, length))
    return pags_fail_at(t->path, "the header holds a zero byte");
  for (char *at = strchr(t->header, '\n') + 1; strncmp(at, "end_header", 10) != 0;) {
    char *end = strchr(at, '\n'); /* never NULL: at least the line of end_header ends with a line break */
    *end = 0;
    if (end > at && end[-1] == '\r')
      end[-1] = 0;
    has_format = has_format || strncmp(at, "format", 6) == 0;
    PAGS_TRY(parse_line(t, ++line, at));
    at = end + 1;
  }
  return has_format ? PAGS_OK : pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected a 'format' line", t->path, line);
}

/* ---- Finding the rows ---- */

/* Converts the rows of element `index` of a text file to little-endian binary and moves *at behind them. If the text
 * ends before the rows do, the element's `rows` stay NULL, which pags_ply_table_need reports. */
static pags_result convert_text(ply_table *t, int index, const char **at) {
  ply_element *e = &t->elements[index];
  uint64_t left = (uint64_t)(t->bytes + t->size - (const uint8_t *)*at);
  /* A number and the blank after it take two bytes: a count that cannot be true is refused before allocating. */
  if (e->property_count == 0 || (uint64_t)e->count > left / 2 / (uint64_t)e->property_count + 1)
    return PAGS_OK;
  uint8_t *rows = malloc((size_t)(e->count * e->stride) + 1);
  PAGS_CHECK_MEMORY(rows, "%s: %lld rows of '%s'", t->path, (long long)e->count, e->name);
  t->converted[index] = rows;
  for (int64_t row = 0; row < e->count; row++) {
    for (int k = 0; k < e->property_count; k++) {
      const ply_property *property = &t->properties[e->first_property + k];
      char *end;
      double value = pags_text_to_double(*at, &end);
      if (end == *at) {
        *at += strspn(*at, " \t\r\n");
        if (!**at)
          return PAGS_OK;
        return pags_fail_at(t->path, "byte %llu: expected a number for '%s' of %s %lld",
                            (unsigned long long)((const uint8_t *)*at - t->bytes), property->name, e->name,
                            (long long)row);
      }

      uint8_t *out = rows + row * e->stride + property->offset;
      switch (property->type) {
        case PLY_FLOAT: pags_store_f32(out, (float)value); break;
        case PLY_DOUBLE: pags_store_f64(out, value); break;
        default: {
          /* A value outside of -2^31..2^32 - 1 becomes 0, since converting it to an integer type could be
           * undefined. */
          const int64_t whole = value >= -2147483648.0 && value <= 4294967295.0 ? (int64_t)value : 0;
          for (int i = 0; i < type_sizes[property->type]; i++)
            out[i] = (uint8_t)((uint64_t)whole >> 8 * i);
        }
      }
      *at = end;
    }
  }
  e->rows = rows;
  return PAGS_OK;
}

/* Sets where the rows of each element begin, in the file or converted. Stops at the first element that cannot be
 * reached (a list property, or the file is too short): its `rows` and those of all later elements stay NULL. */
static pags_result find_rows(ply_table *t, size_t header) {
  uint64_t offset = header;
  const char *at = (const char *)t->bytes + header;
  for (int i = 0; i < t->element_count; i++) {
    ply_element *e = &t->elements[i];
    e->offset = offset;
    if (e->has_list)
      return PAGS_OK;
    if (t->ascii) {
      PAGS_TRY(convert_text(t, i, &at));
      if (!e->rows)
        return PAGS_OK;
      continue;
    }
    if (e->stride && (uint64_t)e->count > (t->size - offset) / (uint64_t)e->stride)
      return PAGS_OK;
    e->rows = t->bytes + offset;
    offset += (uint64_t)e->count * (uint64_t)e->stride;
  }
  return PAGS_OK;
}

bool pags_ply_is(const uint8_t *bytes, size_t size) {
  return size >= 4 && memcmp(bytes, "ply", 3) == 0 && (bytes[3] == '\n' || bytes[3] == '\r');
}

int pags_ply_degree(int properties) {
  for (int degree = 0; degree <= 4; degree++)
    if (properties == 3 * (pags_sh_coefficients(degree) - 1))
      return degree;
  return -1;
}

pags_result pags_ply_table_open(ply_table *table, const char *path, const uint8_t *bytes, size_t size) {
  *table = (ply_table){.path = path, .bytes = bytes, .size = size};
  if (!pags_ply_is(bytes, size))
    return pags_fail(PAGS_ERROR_FORMAT, "%s:1: expected 'ply'", path);
  size_t header = header_length(bytes, size);
  if (header == 0)
    return pags_fail_at(path, "expected 'end_header' within its %zu bytes", size);
  PAGS_TRY(parse_header(table, header));
  return find_rows(table, header);
}

void pags_ply_table_close(ply_table *table) {
  for (int i = 0; i < PLY_MAX_ELEMENTS; i++)
    free(table->converted[i]);
  free(table->properties);
  free(table->header);
  *table = (ply_table){0};
}

/* ---- Access ---- */

const ply_element *pags_ply_table_find(const ply_table *table, const char *element) {
  for (int i = 0; i < table->element_count; i++)
    if (strcmp(table->elements[i].name, element) == 0)
      return &table->elements[i];
  return NULL;
}

pags_result pags_ply_table_need(const ply_table *table, const ply_element *element) {
  if (element->rows)
    return PAGS_OK;
  for (const ply_element *e = table->elements; e <= element; e++)
    if (e->has_list)
      return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: '%s' can't be read: element '%s' has a list property", table->path,
                       element->name, e->name);
  if (table->ascii)
    return pags_fail_at(table->path, "truncated: expected %lld rows of '%s', the file ends at byte %zu",
                        (long long)element->count, element->name, table->size);
  for (const ply_element *e = table->elements; e < element; e++)
    if (!e->rows)
      element = e;
  return pags_fail_at(
      table->path,
      "truncated: expected %lld rows of '%s' (%lld bytes each) from byte %llu on, the file ends at byte %zu",
      (long long)element->count, element->name, (long long)element->stride, (unsigned long long)element->offset,
      table->size);
}

const ply_property *pags_ply_property_find(const ply_table *table, const ply_element *element, const char *property) {
  const ply_property *const first = table->properties + element->first_property;
  for (int i = 0; i < element->property_count; i++)
    if (strcmp(first[i].name, property) == 0)
      return &first[i];
  return NULL;
}

double pags_ply_value(const ply_table *table, const ply_element *element, const ply_property *property, int64_t row) {
  const uint8_t *at = element->rows + row * element->stride + property->offset;
  int size = type_sizes[property->type];
  uint8_t swapped[8];
  if (table->big_endian) {
    for (int i = 0; i < size; i++)
      swapped[i] = at[size - 1 - i];
    at = swapped;
  }
  switch (property->type) {
    case PLY_CHAR: return (int8_t)at[0];
    case PLY_UCHAR: return at[0];
    case PLY_SHORT: return (int16_t)pags_load_u16(at);
    case PLY_USHORT: return pags_load_u16(at);
    case PLY_INT: return (int32_t)pags_load_u32(at);
    case PLY_UINT: return pags_load_u32(at);
    case PLY_FLOAT: return (double)pags_load_f32(at);
    default: return pags_load_f64(at);
  }
}

double pags_ply_origin(const ply_table *table, const ply_element *element, const ply_property *property) {
  enum { MOST = 1024 };
  double values[MOST];
  const int count = element->count < MOST ? (int)element->count : MOST;
  for (int i = 0; i < count; i++)
    values[i] = pags_ply_value(table, element, property, (int64_t)((double)element->count / count * i));
  return pags_large_origin(values, count);
}

void pags_ply_column(const ply_table *table, const ply_element *element, const ply_property *property, double origin,
                     int64_t first, int64_t count, float *out) {
  if (property->type != PLY_FLOAT || table->big_endian || origin != 0) {
    for (int64_t i = 0; i < count; i++)
      out[i] = (float)(pags_ply_value(table, element, property, first + i) - origin);
    return;
  }
  const uint8_t *at = element->rows + first * element->stride + property->offset;
  for (int64_t i = 0; i < count; ++i, at += element->stride)
    out[i] = pags_load_f32(at);
}
