/* SPDX-License-Identifier: Apache-2.0 */
/* A PLY file as tables of numbers: elements, their properties by name, their rows. Knows nothing of Gaussians. */
#ifndef PAGS_SCENE_PLY_TABLE_H
#define PAGS_SCENE_PLY_TABLE_H

#include <stdbool.h>

#include <pags/base.h>

typedef enum ply_type { PLY_CHAR, PLY_UCHAR, PLY_SHORT, PLY_USHORT, PLY_INT, PLY_UINT, PLY_FLOAT, PLY_DOUBLE } ply_type;

typedef struct ply_property {
  const char *name;
  ply_type type;
  int64_t offset; /* bytes from the begin of the row */
} ply_property;

typedef struct ply_element {
  const char *name;
  int64_t count;
  int64_t stride; /* bytes a row */
  int property_count;
  int first_property;  /* of this element in ply_table.properties */
  bool has_list;       /* rows of differing lengths: can't be read, nor can what follows */
  const uint8_t *rows; /* NULL when they can't be reached */
  uint64_t offset;     /* of the rows in the file; 0 for text files */
} ply_element;

enum { PLY_MAX_ELEMENTS = 16 };

typedef struct ply_table {
  const char *path;
  const uint8_t *bytes; /* the file; the caller's */
  size_t size;
  char *header;                        /* a copy, cut into words */
  bool ascii, big_endian, antialiased; /* the last from "comment SplatRenderMode: mip" */
  int element_count, property_count, property_capacity;
  ply_element elements[PLY_MAX_ELEMENTS];
  ply_property *properties;
  uint8_t *converted[PLY_MAX_ELEMENTS]; /* rows of text files in binary */
} ply_table;

/* Parses the header and finds the rows of each element. `bytes` must be terminated by a zero byte that `size` doesn't
 * count, and must outlive the table, as must `path`. */
pags_result pags_ply_table_open(ply_table *table, const char *path, const uint8_t *bytes, size_t size);
void pags_ply_table_close(ply_table *table);

const ply_element *pags_ply_table_find(const ply_table *table, const char *element);
/* Fails, with place and sizes, when the element's rows are not all there. */
pags_result pags_ply_table_need(const ply_table *table, const ply_element *element);

const ply_property *pags_ply_property_find(const ply_table *table, const ply_element *element, const char *property);
double pags_ply_value(const ply_table *table, const ply_element *element, const ply_property *property, int64_t row);
/* Rows [first, first + count) of a property as float; float bits are kept. */
void pags_ply_column(const ply_table *table, const ply_element *element, const ply_property *property, int64_t first,
                     int64_t count, float *out);

#endif
