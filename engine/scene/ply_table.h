/* SPDX-License-Identifier: Apache-2.0 */
/* A PLY file as tables of numbers: elements, their properties by name, and the rows of each element. Independent of
 * what the file holds; ply.c and compressed_ply.c read Gaussians through it, dataset/ply_points.c points. */
#ifndef PAGS_SCENE_PLY_TABLE_H
#define PAGS_SCENE_PLY_TABLE_H

#include <stdbool.h>

#include <pags/scene.h>

typedef enum ply_type { PLY_CHAR, PLY_UCHAR, PLY_SHORT, PLY_USHORT, PLY_INT, PLY_UINT, PLY_FLOAT, PLY_DOUBLE } ply_type;

typedef struct ply_property {
  const char *name;
  ply_type type;
  int64_t offset; /* bytes from the beginning of the row */
} ply_property;

typedef struct ply_element {
  const char *name;
  int64_t count;  /* rows */
  int64_t stride; /* bytes per row */
  int property_count;
  int first_property;  /* index in ply_table.properties of its first property */
  bool has_list;       /* its rows differ in length: neither they nor later elements can be read */
  const uint8_t *rows; /* binary, count * stride bytes; NULL if they cannot be read */
  uint64_t offset;     /* byte in the file where the rows begin; meaningless for text files */
} ply_element;

enum { PLY_MAX_ELEMENTS = 16 };

typedef struct ply_table {
  const char *path;
  const uint8_t *bytes; /* contents of the file, owned by the caller */
  size_t size;
  char *header; /* copy of the header, cut into words; names point into it */
  bool ascii, big_endian;
  pags_splat_facts facts; /* what the comments say: antialiased, up, offset */
  float alpha_min;        /* likewise; 0 if they don't say it */
  int element_count, property_count;
  int64_t property_capacity;
  ply_element elements[PLY_MAX_ELEMENTS];
  ply_property *properties;
  uint8_t *converted[PLY_MAX_ELEMENTS]; /* rows of a text file, converted to binary; NULL for a binary file */
} ply_table;

/* Whether the bytes begin as a PLY file does. */
bool pags_ply_is(const uint8_t *bytes, size_t size);

/* Returns the SH degree, 0 to 4, of a file with this number of f_rest properties; -1 for other numbers. */
int pags_ply_degree(int properties);

/* Parses the header and finds the rows of each element. `bytes` must be terminated by a zero byte that `size` doesn't
 * count. `bytes` and `path` must outlive the table, which the caller closes, also on failure. */
pags_result pags_ply_table_open(ply_table *table, const char *path, const uint8_t *bytes, size_t size);
void pags_ply_table_close(ply_table *table);

/* Returns the PLY element ("vertex", ...) of that name, or NULL. */
const ply_element *pags_ply_table_find(const ply_table *table, const char *element);
/* Fails if the rows of `element` cannot be read: a list property comes before them or the file is truncated. The
 * message names the element, the byte and the sizes. */
pags_result pags_ply_table_need(const ply_table *table, const ply_element *element);

/* Returns the property of that name of `element`, or NULL. */
const ply_property *pags_ply_property_find(const ply_table *table, const ply_element *element, const char *property);
/* Returns the value of a property in row `row`, whatever its type. */
double pags_ply_value(const ply_table *table, const ply_element *element, const ply_property *property, int64_t row);
/* Writes rows [first, first + count) of a property less `origin` to `out` as floats; the bits of values that are floats
 * are kept where `origin` is 0. */
void pags_ply_column(const ply_table *table, const ply_element *element, const ply_property *property, double origin,
                     int64_t first, int64_t count, float *out);
/* The origin (scene/splat_formats.h) for the positions in a property, by up to 1,024 rows spread over the element. */
double pags_ply_origin(const ply_table *table, const ply_element *element, const ply_property *property);

#endif
