/* SPDX-License-Identifier: Apache-2.0 */
/* A JSON reader and writer. The reader stores the line of every value, so that messages can say "path:12: expected a
 * number for 'fl_x'". The writer produces the same bytes for the same calls.
 *
 * The reader accepts RFC 8259 without extensions, but for a byte order mark at the beginning. Nesting is limited to
 * 128 levels; strings are UTF-8, which is not validated, and must not contain U+0000; bytes that aren't UTF-8 are read
 * and written as lone surrogates U+DC80 to U+DCFF, as by Python's "surrogateescape"; the last of duplicate keys counts;
 * numbers are read as double, independent of the locale, and as exact 64-bit integers by the integer getters.
 *
 * A getter takes the document (for the path in messages), an object of it and a key. The getters without _or fail
 * with PAGS_ERROR_FORMAT if the key is missing or its value has another type; those with _or return the fallback if
 * the key is missing or null, and fail only if the value has another type. Strings and values belong to the
 * document. */
#ifndef PAGS_BASE_JSON_H
#define PAGS_BASE_JSON_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/memory.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef enum pags_json_type {
  PAGS_JSON_NULL,
  PAGS_JSON_BOOL,
  PAGS_JSON_NUMBER,
  PAGS_JSON_STRING,
  PAGS_JSON_ARRAY,
  PAGS_JSON_OBJECT
} pags_json_type;

typedef struct pags_json_value {
  pags_json_type type;
  int line;                              /* line of the file where the value begins, from 1 */
  bool boolean;                          /* BOOL: the value */
  double number;                         /* NUMBER: the value, finite */
  const char *text;                      /* STRING: decoded; NUMBER: as written in the file; both end with a zero */
  const char *key;                       /* key of a member of an object; NULL for other values */
  int64_t count;                         /* ARRAY, OBJECT: number of children */
  const struct pags_json_value *first;   /* ARRAY, OBJECT: first child, in file order */
  const struct pags_json_value *next;    /* next child of the same parent; NULL: none */
  const char *source_begin, *source_end; /* text of the value in the file */
} pags_json_value;

typedef struct pags_json pags_json; /* a document; owns all its values */

/* Parses the file at `path`. PAGS_ERROR_IO, PAGS_ERROR_FORMAT ("path:line: ..."), PAGS_ERROR_LIMIT (nested too
 * deeply) or PAGS_ERROR_MEMORY. */
pags_result pags_json_parse_file(const char *path, pags_json **out);
/* Parses `size` bytes of text, which are copied and need no final zero. `name` stands in for the path in messages. */
pags_result pags_json_parse_text(const char *name, const char *text, size_t size, pags_json **out);
/* Parses FOLDER/NAME; *out is NULL if there is no such file. */
pags_result pags_json_parse_in_folder(const char *folder, const char *name, pags_json **out);
void pags_json_destroy(pags_json *json); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_json, pags_json_destroy)

const pags_json_value *pags_json_root(const pags_json *json);
const char *pags_json_path(const pags_json *json);

/* Returns the member of `object` with that key; NULL if it is missing or `object` is NULL or not an object. A member
 * that is null is returned as a value of type PAGS_JSON_NULL. */
const pags_json_value *pags_json_member(const pags_json_value *object, const char *key);

/* Fails with PAGS_ERROR_FORMAT and the message "path:line: ...", the line being that of `value`. */
pags_result pags_json_fail(const pags_json *json, const pags_json_value *value, const char *format, ...)
    PAGS_PRINTF(3, 4);

pags_result pags_json_number(const pags_json *json, const pags_json_value *object, const char *key, double *out);
pags_result pags_json_number_or(const pags_json *json, const pags_json_value *object, const char *key, double fallback,
                                double *out);
/* An integer in [lo, hi], written without fraction or exponent. */
pags_result pags_json_integer(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                              int64_t hi, int64_t *out);
pags_result pags_json_integer_or(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                                 int64_t hi, int64_t fallback, int64_t *out);
/* The same as an int. */
pags_result pags_json_int(const pags_json *json, const pags_json_value *object, const char *key, int lo, int hi,
                          int *out);
pags_result pags_json_int_or(const pags_json *json, const pags_json_value *object, const char *key, int lo, int hi,
                             int fallback, int *out);
pags_result pags_json_unsigned_or(const pags_json *json, const pags_json_value *object, const char *key,
                                  uint64_t fallback, uint64_t *out);
pags_result pags_json_bool_or(const pags_json *json, const pags_json_value *object, const char *key, bool fallback,
                              bool *out);
/* The same as 0 or 1. */
pags_result pags_json_flag_or(const pags_json *json, const pags_json_value *object, const char *key, bool fallback,
                              int *out);
pags_result pags_json_string(const pags_json *json, const pags_json_value *object, const char *key, const char **out);
pags_result pags_json_string_copy(const pags_json *json, const pags_json_value *object, const char *key,
                                  char **out); /* freed by the caller; PAGS_ERROR_MEMORY too */
pags_result pags_json_string_or(const pags_json *json, const pags_json_value *object, const char *key,
                                const char *fallback, const char **out);
pags_result pags_json_array(const pags_json *json, const pags_json_value *object, const char *key,
                            const pags_json_value **out);
pags_result pags_json_object(const pags_json *json, const pags_json_value *object, const char *key,
                             const pags_json_value **out);
/* An array of exactly `count` numbers; it may be nested (a 4x4 matrix as four arrays of four is 16 numbers). */
pags_result pags_json_numbers(const pags_json *json, const pags_json_value *object, const char *key, int count,
                              double *out);
/* The same; `out` stays as it is if the key is missing (`_if`: null is an error) or null as well (`_or`). */
pags_result pags_json_numbers_if(const pags_json *json, const pags_json_value *object, const char *key, int count,
                                 double *out);
pags_result pags_json_numbers_or(const pags_json *json, const pags_json_value *object, const char *key, int count,
                                 double *out);

/* Getters for a value without a key, such as an element of an array; `what` names the value in messages. */
pags_result pags_json_as_number(const pags_json *json, const pags_json_value *value, const char *what, double *out);
pags_result pags_json_as_string(const pags_json *json, const pags_json_value *value, const char *what,
                                const char **out);
pags_result pags_json_as_object(const pags_json *json, const pags_json_value *value, const char *what);

/* The writer. An object or array is opened by begin, filled by put and closed by end; `key` is NULL for elements of
 * an array and for the outermost value. A failed allocation is remembered and reported by pags_json_writer_finish.
 * Doubles are written as the shortest text that reads back to the same bits; NaN and infinities, which JSON cannot
 * express, are written as null. */
typedef struct pags_json_writer {
  char *data; /* the text, with a final zero; NULL while it is empty */
  size_t size;
  int64_t capacity;
  int indent;       /* spaces per level; 0: everything on one line */
  int depth;        /* number of open objects and arrays */
  bool has_sibling; /* the innermost open object or array has a value already */
  bool flat;        /* no line breaks: inside of pags_json_put_numbers */
  bool failed;      /* an allocation failed */
} pags_json_writer;

void pags_json_writer_init(pags_json_writer *writer, int indent);
void pags_json_writer_destroy(pags_json_writer *writer);
void pags_json_begin_object(pags_json_writer *writer, const char *key);
void pags_json_end_object(pags_json_writer *writer);
void pags_json_begin_array(pags_json_writer *writer, const char *key);
void pags_json_end_array(pags_json_writer *writer);
void pags_json_put_number(pags_json_writer *writer, const char *key, double value);
void pags_json_put_integer(pags_json_writer *writer, const char *key, int64_t value);
void pags_json_put_unsigned(pags_json_writer *writer, const char *key, uint64_t value);
void pags_json_put_bool(pags_json_writer *writer, const char *key, bool value);
void pags_json_put_null(pags_json_writer *writer, const char *key);
void pags_json_put_string(pags_json_writer *writer, const char *key, const char *value); /* NULL: null */
void pags_json_put_numbers(pags_json_writer *writer, const char *key, const double *values,
                           int count); /* on one line */
/* Writes `text`, which must be a valid JSON value, unchanged. */
void pags_json_put_raw(pags_json_writer *writer, const char *key, const char *text);
/* Ends the text with a line break; all objects and arrays must have been closed. PAGS_ERROR_MEMORY if an allocation
 * has failed. The text stays in `data` until pags_json_writer_destroy. */
pags_result pags_json_writer_finish(pags_json_writer *writer);
/* Finishes the text and writes it to the file at `path` with pags_file_write. */
pags_result pags_json_writer_save(pags_json_writer *writer, const char *path);
pags_result pags_json_writer_save_in_folder(pags_json_writer *writer, const char *folder, const char *name);

#ifdef __cplusplus
}
#endif
#endif
