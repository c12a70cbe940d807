/* SPDX-License-Identifier: Apache-2.0 */
/* JSON: a reader whose every value knows its line, so that messages can say "path:12: expected a number for 'fl_x'",
 * and a writer that gives the same bytes for the same calls.
 *
 * The reader takes RFC 8259 and nothing more. Nesting is limited to 128 levels; strings pass through as UTF-8 and must
 * not contain U+0000; of duplicate keys the last wins; numbers are read as double, independent of the locale, and as
 * exact 64-bit integers where one is asked for.
 *
 * Getters take the document for its path, an object of it and a key. The plain ones fail with PAGS_ERROR_FORMAT when
 * the key is missing or of another type; the _or ones give the fallback when it is missing or null, and fail only when
 * it is of another type. Strings and values belong to the document. */
#ifndef PAGS_BASE_JSON_H
#define PAGS_BASE_JSON_H

#include <stdbool.h>

#include <pags/base.h>

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
  int line;                              /* where it begins, from 1 */
  bool boolean;                          /* BOOL */
  double number;                         /* NUMBER; finite */
  const char *text;                      /* STRING: decoded, terminated; NUMBER: as written, terminated */
  const char *key;                       /* of a member of an object, else NULL */
  int64_t count;                         /* ARRAY, OBJECT: children */
  const struct pags_json_value *first;   /* ARRAY, OBJECT: first child, in file order */
  const struct pags_json_value *next;    /* sibling */
  const char *source_begin, *source_end; /* its text in the file */
} pags_json_value;

typedef struct pags_json pags_json; /* a document; owns all its values */

/* `path` is also what messages begin with. PAGS_ERROR_IO, _FORMAT ("path:line: ..."), _MEMORY. */
pags_result pags_json_parse_file(const char *path, pags_json **out);
/* `name` stands for the path in messages; `text` need not be terminated and may go away afterwards. */
pags_result pags_json_parse_text(const char *name, const char *text, size_t size, pags_json **out);
void pags_json_destroy(pags_json *json); /* NULL is allowed */

const pags_json_value *pags_json_root(const pags_json *json);
const char *pags_json_path(const pags_json *json);

/* The member, NULL when there is none (a null member is returned as such). `object` may be of any type. */
const pags_json_value *pags_json_member(const pags_json_value *object, const char *key);

/* Fails with "path:line: " before the message; `value` gives the line. */
pags_result pags_json_fail(const pags_json *json, const pags_json_value *value, const char *format, ...)
    PAGS_PRINTF(3, 4);

pags_result pags_json_number(const pags_json *json, const pags_json_value *object, const char *key, double *out);
pags_result pags_json_number_or(const pags_json *json, const pags_json_value *object, const char *key, double fallback,
                                double *out);
/* An integer without fraction or exponent within [lo, hi]. */
pags_result pags_json_integer(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                              int64_t hi, int64_t *out);
pags_result pags_json_integer_or(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                                 int64_t hi, int64_t fallback, int64_t *out);
pags_result pags_json_unsigned_or(const pags_json *json, const pags_json_value *object, const char *key,
                                  uint64_t fallback, uint64_t *out);
pags_result pags_json_bool_or(const pags_json *json, const pags_json_value *object, const char *key, bool fallback,
                              bool *out);
pags_result pags_json_string(const pags_json *json, const pags_json_value *object, const char *key, const char **out);
pags_result pags_json_string_copy(const pags_json *json, const pags_json_value *object, const char *key,
                                  char **out); /* freed by the caller; PAGS_ERROR_MEMORY too */
pags_result pags_json_string_or(const pags_json *json, const pags_json_value *object, const char *key,
                                const char *fallback, const char **out);
pags_result pags_json_array(const pags_json *json, const pags_json_value *object, const char *key,
                            const pags_json_value **out);
pags_result pags_json_object(const pags_json *json, const pags_json_value *object, const char *key,
                             const pags_json_value **out);
/* Exactly `count` numbers in an array, which may be nested (a 4x4 matrix as four arrays of four is 16 numbers). */
pags_result pags_json_numbers(const pags_json *json, const pags_json_value *object, const char *key, int count,
                              double *out);

/* Values by themselves, for the elements of arrays; `what` names the value in the message. */
pags_result pags_json_as_number(const pags_json *json, const pags_json_value *value, const char *what, double *out);
pags_result pags_json_as_string(const pags_json *json, const pags_json_value *value, const char *what,
                                const char **out);
pags_result pags_json_as_object(const pags_json *json, const pags_json_value *value, const char *what);

/* The writer: begin ... end around objects and arrays, put between; `key` is NULL in arrays and at the top. Failed
 * allocations are remembered and reported by finish. Doubles are written as the shortest text that reads back to the
 * same bits; NaN and infinities, which JSON can't express, as null. */
typedef struct pags_json_writer {
  char *data; /* terminated once anything was put */
  size_t size, capacity;
  int indent;       /* spaces a level; 0: everything on one line */
  int depth;        /* open objects and arrays */
  bool has_sibling; /* something was put at this level */
  bool flat;        /* inside put_numbers */
  bool failed;
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
/* `text` must be valid JSON by itself; it goes in as it is. */
void pags_json_put_raw(pags_json_writer *writer, const char *key, const char *text);
/* PAGS_ERROR_MEMORY when anything failed; everything must have been ended. The text stays in data until destroy and
 * ends with a newline. */
pags_result pags_json_writer_finish(pags_json_writer *writer);
/* finish + pags_file_write. */
pags_result pags_json_writer_save(pags_json_writer *writer, const char *path);

#ifdef __cplusplus
}
#endif
#endif
