/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON reader (base/json.h): a recursive-descent parser of the whole text, which builds a tree of values in the
 * order of the file. */
#include "base/json.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

enum { DEPTH_LIMIT = 128, BLOCK_VALUES = 512 };

/* Values are allocated in blocks that are never resized, since parents and siblings point to values. */
typedef struct block {
  struct block *next;
  int used;
  pags_json_value values[BLOCK_VALUES];
} block;

struct pags_json {
  char *path;
  char *source;  /* the text of the file, with a final zero */
  char *strings; /* decoded strings, and numbers as written, each with a final zero: at most the source's size + 1 */
  block *blocks;
  const pags_json_value *root;
};

typedef struct reader {
  pags_json *json;
  const char *at, *end;
  char *string_at;
  int line, depth;
  const pags_json_value *open[DEPTH_LIMIT]; /* the value that is read, and those that it is in */
} reader;

static pags_result syntax_error(const reader *r, const char *expected) {
  unsigned char c = r->at < r->end ? (unsigned char)*r->at : 0;
  const char *path = r->json->path;
  if (r->at >= r->end)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s, found the end of the file", path, r->line, expected);
  if (c > 32 && c < 127)
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s, found '%c'", path, r->line, expected, c);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: expected %s, found byte 0x%02x", path, r->line, expected, c);
}

/* Fails if a number that JSON doesn't have is next, as Python's json.dump writes it. The message has the place of the
 * value, like "4.frame_annotations.obj_to_world[2][0][3]"; long ones are cut off. */
static pags_result check_finite(const reader *r) {
  static const char *const words[] = {"NaN", "nan", "-nan", "-NaN", "Infinity", "-Infinity", "inf", "-inf"};
  size_t w = 0;
  while (w < sizeof words / sizeof *words && !pags_text_starts(r->at, words[w]))
    w++;
  if (w == sizeof words / sizeof *words)
    return PAGS_OK;
  char place[200] = "";
  size_t used = 0;
  for (int i = 1; i < r->depth && used + 1 < sizeof place; i++) {
    const char *key = r->open[i]->key;
    const int length = key ? snprintf(place + used, sizeof place - used, "%s%s", used ? "." : "", key)
                           : snprintf(place + used, sizeof place - used, "[%lld]", (long long)r->open[i - 1]->count);
    used += length > 0 ? (size_t)length : 0;
  }
  return pags_fail(PAGS_ERROR_FORMAT,
                   "%s:%d: expected a number for %s, found %s, which JSON doesn't have (Python's json.dump writes it); "
                   "leave out what isn't known",
                   r->json->path, r->line, *place ? place : "the value", words[w]);
}

static void skip_space(reader *r) {
  for (; r->at < r->end; r->at++) {
    if (*r->at == '\n')
      r->line++;
    else if (*r->at != ' ' && *r->at != '\t' && *r->at != '\r')
      return;
  }
}

/* Skips the next character if it is `c`. */
static bool skip(reader *r, char c) {
  const bool found = r->at < r->end && *r->at == c;
  r->at += found;
  return found;
}

/* ---- Numbers ---- */

static bool is_digit(const reader *r) {
  return r->at < r->end && *r->at >= '0' && *r->at <= '9';
}

static bool skip_digits(reader *r) {
  if (!is_digit(r))
    return false;
  while (is_digit(r))
    r->at++;
  return true;
}

static pags_result read_number(reader *r, pags_json_value *value) {
  const char *begin = r->at;
  skip(r, '-');
  if (!skip(r, '0') && !skip_digits(r))
    return syntax_error(r, "a digit");
  if (skip(r, '.') && !skip_digits(r))
    return syntax_error(r, "a digit after the point");
  if (skip(r, 'e') || skip(r, 'E')) {
    if (!skip(r, '+'))
      skip(r, '-');
    if (!skip_digits(r))
      return syntax_error(r, "a digit of the exponent");
  }
  const size_t length = (size_t)(r->at - begin);
  memcpy(r->string_at, begin, length);
  r->string_at[length] = 0;
  value->type = PAGS_JSON_NUMBER;
  value->text = r->string_at;
  value->number = pags_text_to_double(value->text, NULL);
  r->string_at += length + 1;
  if (!isfinite(value->number))
    return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: the number %.40s is too large", r->json->path, r->line, value->text);
  return PAGS_OK;
}

/* ---- Strings ---- */

/* Reads the four hexadecimal digits after "\u". */
static pags_result read_hex4(reader *r, unsigned *code) {
  static const char digits[] = "0123456789abcdef";
  *code = 0;
  for (int i = 0; i < 4; i++, r->at++) {
    const char c = r->at < r->end ? *r->at : 0;
    const char *digit = c ? strchr(digits, c >= 'A' && c <= 'F' ? c - 'A' + 'a' : c) : NULL;
    if (!digit)
      return syntax_error(r, "four hexadecimal digits after \\u");
    *code = *code * 16 + (unsigned)(digit - digits);
  }
  return PAGS_OK;
}

/* Reads the digits after "\u", with the second half of a surrogate pair, and stores the character as UTF-8. U+DC80 to
 * U+DCFF alone are bytes that aren't UTF-8 (json_write.c). */
static pags_result read_unicode_escape(reader *r) {
  unsigned code, low;
  PAGS_TRY(read_hex4(r, &code));
  if (code >= 0xD800 && code < 0xDC00) {
    if (r->end - r->at < 2 || r->at[0] != '\\' || r->at[1] != 'u')
      return syntax_error(r, "the second half of a surrogate pair");
    r->at += 2;
    PAGS_TRY(read_hex4(r, &low));
    if (low < 0xDC00 || low > 0xDFFF)
      return syntax_error(r, "the second half of a surrogate pair before this");
    code = 0x10000 + ((code - 0xD800) << 10) + (low - 0xDC00);
  } else if (code >= 0xDC80 && code <= 0xDCFF) {
    *r->string_at++ = (char)(code & 0xFF);
    return PAGS_OK;
  } else if (code >= 0xDC00 && code <= 0xDFFF) {
    return syntax_error(r, "the first half of a surrogate pair before this");
  }
  if (code == 0)
    return syntax_error(r, "a string without \\u0000 before this");

  /* Encodes the code point in UTF-8, which takes at most as many bytes as the escape. */
  static const unsigned lead[] = {0, 0xC0, 0xE0, 0xF0};
  const int more = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
  *r->string_at++ = (char)(lead[more] | code >> 6 * more);
  for (int i = more - 1; i >= 0; i--)
    *r->string_at++ = (char)(0x80 | (code >> 6 * i & 63));
  return PAGS_OK;
}

static pags_result read_string(reader *r, const char **out) {
  static const char names[] = "\"\\/bfnrt", values[] = "\"\\/\b\f\n\r\t"; /* of escapes of one letter */
  *out = r->string_at;
  r->at++;
  for (;;) {
    if (r->at >= r->end || (unsigned char)*r->at < 0x20)
      return syntax_error(r, "the end of a string");
    const char c = *r->at++;
    if (c == '"')
      break;
    if (c != '\\') {
      *r->string_at++ = c;
      continue;
    }
    const char *found = r->at < r->end && *r->at ? strchr(names, *r->at) : NULL;
    if (found) {
      *r->string_at++ = values[found - names];
      r->at++;
    } else if (skip(r, 'u')) {
      PAGS_TRY(read_unicode_escape(r));
    } else {
      return syntax_error(r, "an escape sequence");
    }
  }
  *r->string_at++ = 0;
  return PAGS_OK;
}

/* ---- Values ---- */

static pags_result read_word(reader *r, const char *word) {
  if (!pags_text_starts(r->at, word))
    return syntax_error(r, "a value");
  r->at += strlen(word);
  return PAGS_OK;
}

static pags_result read_value(reader *r, const char *key, pags_json_value **out);

/* Reads the members of an object or the elements of an array up to `close`, from the opening bracket on. */
static pags_result read_children(reader *r, pags_json_value *parent, char close) {
  const pags_json_value **link = &parent->first;
  r->at++;
  skip_space(r);
  if (skip(r, close))
    return PAGS_OK;
  for (;;) {
    const char *key = NULL;
    pags_json_value *child;
    if (close == '}') {
      skip_space(r);
      if (r->at >= r->end || *r->at != '"')
        return syntax_error(r, "a key in quotes");
      PAGS_TRY(read_string(r, &key));
      skip_space(r);
      if (!skip(r, ':'))
        return syntax_error(r, "':'");
    }
    PAGS_TRY(read_value(r, key, &child));
    *link = child;
    link = &child->next;
    parent->count++;
    skip_space(r);
    if (skip(r, close))
      return PAGS_OK;
    if (!skip(r, ','))
      return syntax_error(r, close == '}' ? "',' or '}'" : "',' or ']'");
  }
}

static pags_result read_content(reader *r, pags_json_value *value) {
  char c = r->at < r->end ? *r->at : 0;
  if (c == 'N' || c == 'n' || c == 'I' || c == 'i' || c == '-')
    PAGS_TRY(check_finite(r));
  switch (c) {
    case '{':
    case '[':
      value->type = c == '{' ? PAGS_JSON_OBJECT : PAGS_JSON_ARRAY;
      return read_children(r, value, c == '{' ? '}' : ']');
    case '"': value->type = PAGS_JSON_STRING; return read_string(r, &value->text);
    case 't':
    case 'f':
      value->type = PAGS_JSON_BOOL;
      value->boolean = c == 't';
      return read_word(r, c == 't' ? "true" : "false");
    case 'n': return read_word(r, "null");
    default: return c == '-' || is_digit(r) ? read_number(r, value) : syntax_error(r, "a value");
  }
}

static pags_result read_value(reader *r, const char *key, pags_json_value **out) {
  skip_space(r);
  pags_json *json = r->json;
  if (!json->blocks || json->blocks->used == BLOCK_VALUES) {
    block *fresh = calloc(1, sizeof *fresh);
    PAGS_CHECK_MEMORY(fresh, "%s:%d: the values of the file", json->path, r->line);
    fresh->next = json->blocks;
    json->blocks = fresh;
  }
  pags_json_value *value = &json->blocks->values[json->blocks->used++];
  if (++r->depth > DEPTH_LIMIT)
    return pags_fail(PAGS_ERROR_LIMIT, "%s:%d: nested deeper than %d levels", json->path, r->line, DEPTH_LIMIT);
  r->open[r->depth - 1] = value;
  value->line = r->line;
  value->key = key;
  value->source_begin = r->at;
  PAGS_TRY(read_content(r, value));
  value->source_end = r->at;
  r->depth--;
  *out = value;
  return PAGS_OK;
}

/* ---- Documents ---- */

/* Parses `source`, a block of size + 1 bytes with a final zero, and takes ownership of it, also on failure. */
static pags_result parse_owned(const char *path, char *source, size_t size, pags_json **out) {
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = calloc(1, sizeof *json);
  if (!json) {
    free(source);
    return pags_out_of_memory("%s", path);
  }
  json->source = source;
  json->path = pags_text_copy(path);
  json->strings = size <= SIZE_MAX - 2 ? malloc(size + 2) : NULL;
  PAGS_CHECK_MEMORY(json->path && json->strings, "%s", path);
  reader r = {.json = json, .at = source, .end = source + size, .string_at = json->strings, .line = 1};
  if (pags_text_starts(source, "\xEF\xBB\xBF"))
    r.at += 3; /* a byte order mark, as some Windows programs write it */
  pags_json_value *root;
  PAGS_TRY(read_value(&r, NULL, &root));
  skip_space(&r);
  if (r.at != r.end)
    return syntax_error(&r, "the end of the file");
  json->root = root;
  *out = pags_take(&json);
  return PAGS_OK;
}

pags_result pags_json_parse_file(const char *path, pags_json **out) {
  uint8_t *bytes;
  size_t size;
  *out = NULL;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return parse_owned(path, (char *)bytes, size, out);
}

pags_result pags_json_parse_in_folder(const char *folder, const char *name, pags_json **out) {
  *out = NULL;
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  PAGS_CHECK_MEMORY(path, "%s", folder);
  return pags_file_exists(path) ? pags_json_parse_file(path, out) : PAGS_OK;
}

pags_result pags_json_parse_text(const char *name, const char *text, size_t size, pags_json **out) {
  *out = NULL;
  char *copy = size < SIZE_MAX ? malloc(size + 1) : NULL;
  PAGS_CHECK_MEMORY(copy, "%s", name);
  memcpy(copy, text, size);
  copy[size] = 0;
  return parse_owned(name, copy, size, out);
}

void pags_json_destroy(pags_json *json) {
  if (!json)
    return;
  while (json->blocks) {
    block *next = json->blocks->next;
    free(json->blocks);
    json->blocks = next;
  }
  free(json->strings);
  free(json->source);
  free(json->path);
  free(json);
}

const pags_json_value *pags_json_root(const pags_json *json) {
  return json->root;
}

const char *pags_json_path(const pags_json *json) {
  return json->path;
}

pags_result pags_json_fail(const pags_json *json, const pags_json_value *value, const char *format, ...) {
  char text[900];
  va_list arguments;
  va_start(arguments, format);
  vsnprintf(text, sizeof text, format, arguments);
  va_end(arguments);
  return pags_fail(PAGS_ERROR_FORMAT, "%s:%d: %s", json->path, value->line, text);
}
