/* SPDX-License-Identifier: Apache-2.0 */
/* Getters of base/json.h: look up a member by key, check its type and range, and convert it. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"

static const char *const type_names[] = {"null", "true or false", "a number", "a string", "an array", "an object"};

const pags_json_value *pags_json_member(const pags_json_value *object, const char *key) {
  const pags_json_value *found = NULL;
  if (!object || object->type != PAGS_JSON_OBJECT)
    return NULL;
  for (const pags_json_value *child = object->first; child; child = child->next)
    if (strcmp(child->key, key) == 0)
      found = child;
  return found;
}

static pags_result fail_type(const pags_json *json, const pags_json_value *value, const char *expected,
                             const char *key) {
  return pags_json_fail(json, value, "expected %s for '%s', found %s", expected, key, type_names[value->type]);
}

/* Returns the member under `key`; fails if it is missing or not of the type. */
static pags_result get(const pags_json *json, const pags_json_value *object, const char *key, pags_json_type type,
                       const pags_json_value **out) {
  if (object->type != PAGS_JSON_OBJECT)
    return pags_json_fail(json, object, "expected an object with '%s', found %s", key, type_names[object->type]);
  const pags_json_value *value = pags_json_member(object, key);
  if (!value)
    return pags_json_fail(json, object, "expected %s for '%s', which is missing", type_names[type], key);
  if (value->type != type)
    return fail_type(json, value, type_names[type], key);
  *out = value;
  return PAGS_OK;
}

/* Returns whether `object` is an object in which the key is missing or null. */
static bool is_absent(const pags_json_value *object, const char *key) {
  const pags_json_value *value = pags_json_member(object, key);
  return object->type == PAGS_JSON_OBJECT && (!value || value->type == PAGS_JSON_NULL);
}

pags_result pags_json_number(const pags_json *json, const pags_json_value *object, const char *key, double *out) {
  const pags_json_value *value = NULL;
  PAGS_TRY(get(json, object, key, PAGS_JSON_NUMBER, &value));
  *out = value->number;
  return PAGS_OK;
}

pags_result pags_json_number_or(const pags_json *json, const pags_json_value *object, const char *key, double fallback,
                                double *out) {
  *out = fallback;
  return is_absent(object, key) ? PAGS_OK : pags_json_number(json, object, key, out);
}

pags_result pags_json_integer(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                              int64_t hi, int64_t *out) {
  const pags_json_value *value = NULL;
  PAGS_TRY(get(json, object, key, PAGS_JSON_NUMBER, &value));
  char *end;
  errno = 0;
  long long integer = strtoll(value->text, &end, 10);
  if (*end || errno || integer < lo || integer > hi)
    return pags_json_fail(json, value, "expected an integer from %lld to %lld for '%s', found %.40s", (long long)lo,
                          (long long)hi, key, value->text);
  *out = integer;
  return PAGS_OK;
}

pags_result pags_json_integer_or(const pags_json *json, const pags_json_value *object, const char *key, int64_t lo,
                                 int64_t hi, int64_t fallback, int64_t *out) {
  *out = fallback;
  return is_absent(object, key) ? PAGS_OK : pags_json_integer(json, object, key, lo, hi, out);
}

pags_result pags_json_int(const pags_json *json, const pags_json_value *object, const char *key, int lo, int hi,
                          int *out) {
  int64_t integer = 0;
  PAGS_TRY(pags_json_integer(json, object, key, lo, hi, &integer));
  *out = (int)integer;
  return PAGS_OK;
}

pags_result pags_json_int_or(const pags_json *json, const pags_json_value *object, const char *key, int lo, int hi,
                             int fallback, int *out) {
  *out = fallback;
  return is_absent(object, key) ? PAGS_OK : pags_json_int(json, object, key, lo, hi, out);
}

pags_result pags_json_unsigned_or(const pags_json *json, const pags_json_value *object, const char *key,
                                  uint64_t fallback, uint64_t *out) {
  const pags_json_value *value = NULL;
  *out = fallback;
  if (is_absent(object, key))
    return PAGS_OK;
  PAGS_TRY(get(json, object, key, PAGS_JSON_NUMBER, &value));
  char *end;
  errno = 0;
  unsigned long long integer = strtoull(value->text, &end, 10);
  if (*end || errno || value->text[0] == '-')
    return pags_json_fail(json, value, "expected an integer from 0 to 2^64 - 1 for '%s', found %.40s", key,
                          value->text);
  *out = integer;
  return PAGS_OK;
}

pags_result pags_json_bool_or(const pags_json *json, const pags_json_value *object, const char *key, bool fallback,
                              bool *out) {
  const pags_json_value *value = NULL;
  *out = fallback;
  if (is_absent(object, key))
    return PAGS_OK;
  PAGS_TRY(get(json, object, key, PAGS_JSON_BOOL, &value));
  *out = value->boolean;
  return PAGS_OK;
}

pags_result pags_json_flag_or(const pags_json *json, const pags_json_value *object, const char *key, bool fallback,
                              int *out) {
  bool value;
  PAGS_TRY(pags_json_bool_or(json, object, key, fallback, &value));
  *out = value;
  return PAGS_OK;
}

pags_result pags_json_string(const pags_json *json, const pags_json_value *object, const char *key, const char **out) {
  const pags_json_value *value = NULL;
  PAGS_TRY(get(json, object, key, PAGS_JSON_STRING, &value));
  *out = value->text;
  return PAGS_OK;
}

pags_result pags_json_string_copy(const pags_json *json, const pags_json_value *object, const char *key, char **out) {
  const char *text;
  PAGS_TRY(pags_json_string(json, object, key, &text));
  *out = pags_text_copy(text);
  PAGS_CHECK_MEMORY(*out, "%s: '%s'", pags_json_path(json), key);
  return PAGS_OK;
}

pags_result pags_json_string_or(const pags_json *json, const pags_json_value *object, const char *key,
                                const char *fallback, const char **out) {
  *out = fallback;
  return is_absent(object, key) ? PAGS_OK : pags_json_string(json, object, key, out);
}

pags_result pags_json_array(const pags_json *json, const pags_json_value *object, const char *key,
                            const pags_json_value **out) {
  return get(json, object, key, PAGS_JSON_ARRAY, out);
}

pags_result pags_json_object(const pags_json *json, const pags_json_value *object, const char *key,
                             const pags_json_value **out) {
  return get(json, object, key, PAGS_JSON_OBJECT, out);
}

/* Appends all numbers of the array `value` and the arrays within it to `out`, in file order. *filled counts them,
 * also beyond `count`, but no more than `count` are stored. Returns the first value that is neither array nor number,
 * or NULL. The recursion is bounded, since the reader limits the nesting. */
static const pags_json_value *flatten(const pags_json_value *value, int count, double *out, int64_t *filled) {
  for (const pags_json_value *child = value->first; child; child = child->next) {
    if (child->type == PAGS_JSON_ARRAY) {
      const pags_json_value *bad = flatten(child, count, out, filled);
      if (bad)
        return bad;
    } else if (child->type == PAGS_JSON_NUMBER) {
      if (*filled < count)
        out[*filled] = child->number;
      ++*filled;
    } else {
      return child;
    }
  }
  return NULL;
}

pags_result pags_json_numbers(const pags_json *json, const pags_json_value *object, const char *key, int count,
                              double *out) {
  const pags_json_value *value = NULL;
  int64_t filled = 0;
  PAGS_TRY(get(json, object, key, PAGS_JSON_ARRAY, &value));
  const pags_json_value *bad = flatten(value, count, out, &filled);
  if (bad)
    return fail_type(json, bad, "a number", key);
  if (filled != count)
    return pags_json_fail(json, value, "expected %d numbers for '%s', found %lld", count, key, (long long)filled);
  return PAGS_OK;
}

pags_result pags_json_numbers_if(const pags_json *json, const pags_json_value *object, const char *key, int count,
                                 double *out) {
  return pags_json_member(object, key) ? pags_json_numbers(json, object, key, count, out) : PAGS_OK;
}

pags_result pags_json_numbers_or(const pags_json *json, const pags_json_value *object, const char *key, int count,
                                 double *out) {
  return is_absent(object, key) ? PAGS_OK : pags_json_numbers(json, object, key, count, out);
}

pags_result pags_json_as_number(const pags_json *json, const pags_json_value *value, const char *what, double *out) {
  if (value->type != PAGS_JSON_NUMBER)
    return fail_type(json, value, "a number", what);
  *out = value->number;
  return PAGS_OK;
}

pags_result pags_json_as_string(const pags_json *json, const pags_json_value *value, const char *what,
                                const char **out) {
  if (value->type != PAGS_JSON_STRING)
    return fail_type(json, value, "a string", what);
  *out = value->text;
  return PAGS_OK;
}

pags_result pags_json_as_object(const pags_json *json, const pags_json_value *value, const char *what) {
  return value->type == PAGS_JSON_OBJECT ? PAGS_OK : fail_type(json, value, "an object", what);
}
