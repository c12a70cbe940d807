/* SPDX-License-Identifier: Apache-2.0 */
/* The JSON writer (base/json.h): appends values to a growing text and puts in commas, line breaks, indents and
 * escapes. */
#include <assert.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/text.h"

/* Appends `size` bytes and a final zero. */
static void put(pags_json_writer *w, const char *text, size_t size) {
  if (w->failed)
    return;
  w->failed = !pags_grow(&w->data, (int64_t)(w->size + size) + 1, &w->capacity, 1);
  if (w->failed)
    return;
  memcpy(w->data + w->size, text, size);
  w->size += size;
  w->data[w->size] = 0;
}

static void put_text(pags_json_writer *w, const char *text) {
  put(w, text, strlen(text));
}

/* Breaks the line and indents the new one by the depth; nothing if the writer writes one line. */
static void put_line_break(pags_json_writer *w) {
  if (!w->indent || w->flat)
    return;
  put(w, "\n", 1);
  for (int i = 0; i < w->depth * w->indent; i++)
    put(w, " ", 1);
}

/* A byte that isn't UTF-8, as in a file name of an old disk, is written as the lone surrogate that Python's
 * "surrogateescape" gives it, U+DC80 to U+DCFF, and so reads back as it was. */
static void put_stray(pags_json_writer *w, char byte) {
  char escape[8];
  put(w, escape, (size_t)snprintf(escape, sizeof escape, "\\udc%02x", (unsigned char)byte));
}

static void put_quoted(pags_json_writer *w, const char *text) {
  put(w, "\"", 1);
  for (const char *at = text; *at; at++) {
    const unsigned char c = (unsigned char)*at;
    const size_t length = pags_text_utf8(at);
    char escape[8];
    if (c == '"' || c == '\\')
      put(w, (char[]){'\\', *at}, 2);
    else if (c == '\n')
      put(w, "\\n", 2);
    else if (c == '\t')
      put(w, "\\t", 2);
    else if (c < 0x20)
      put(w, escape, (size_t)snprintf(escape, sizeof escape, "\\u%04x", c));
    else if (!length)
      put_stray(w, *at);
    else {
      put(w, at, length);
      at += length - 1;
    }
  }
  put(w, "\"", 1);
}

/* Writes the text before a value: the comma after the previous value, the line break, the key (NULL: none). */
static void begin_value(pags_json_writer *w, const char *key) {
  if (w->has_sibling)
    put_text(w, w->flat || !w->indent ? ", " : ",");
  if (w->depth)
    put_line_break(w);
  if (key) {
    put_quoted(w, key);
    put(w, ": ", 2);
  }
  w->has_sibling = true;
}

static void begin_nested(pags_json_writer *w, const char *key, const char *open) {
  begin_value(w, key);
  put_text(w, open);
  w->depth++;
  w->has_sibling = false;
}

static void end_nested(pags_json_writer *w, const char *close) {
  assert(w->depth > 0);
  w->depth--;
  if (w->has_sibling)
    put_line_break(w);
  put_text(w, close);
  w->has_sibling = true;
}

void pags_json_writer_init(pags_json_writer *writer, int indent) {
  *writer = (pags_json_writer){.indent = indent};
}

void pags_json_writer_destroy(pags_json_writer *writer) {
  free(writer->data);
  *writer = (pags_json_writer){0};
}

void pags_json_begin_object(pags_json_writer *writer, const char *key) {
  begin_nested(writer, key, "{");
}
void pags_json_end_object(pags_json_writer *writer) {
  end_nested(writer, "}");
}
void pags_json_begin_array(pags_json_writer *writer, const char *key) {
  begin_nested(writer, key, "[");
}
void pags_json_end_array(pags_json_writer *writer) {
  end_nested(writer, "]");
}

void pags_json_put_number(pags_json_writer *writer, const char *key, double value) {
  char text[PAGS_DOUBLE_TEXT];
  begin_value(writer, key);
  if (isfinite(value))
    put(writer, text, (size_t)pags_text_from_double(value, text));
  else
    put_text(writer, "null");
}

void pags_json_put_integer(pags_json_writer *writer, const char *key, int64_t value) {
  char text[PAGS_DOUBLE_TEXT];
  begin_value(writer, key);
  put(writer, text, (size_t)snprintf(text, sizeof text, "%lld", (long long)value));
}

void pags_json_put_unsigned(pags_json_writer *writer, const char *key, uint64_t value) {
  char text[PAGS_DOUBLE_TEXT];
  begin_value(writer, key);
  put(writer, text, (size_t)snprintf(text, sizeof text, "%llu", (unsigned long long)value));
}

void pags_json_put_bool(pags_json_writer *writer, const char *key, bool value) {
  pags_json_put_raw(writer, key, value ? "true" : "false");
}

void pags_json_put_null(pags_json_writer *writer, const char *key) {
  pags_json_put_raw(writer, key, "null");
}

void pags_json_put_string(pags_json_writer *writer, const char *key, const char *value) {
  if (!value) {
    pags_json_put_null(writer, key);
    return;
  }
  begin_value(writer, key);
  put_quoted(writer, value);
}

void pags_json_put_numbers(pags_json_writer *writer, const char *key, const double *values, int count) {
  bool outer = writer->flat;
  begin_nested(writer, key, "[");
  writer->flat = true;
  for (int i = 0; i < count; i++)
    pags_json_put_number(writer, NULL, values[i]);
  end_nested(writer, "]");
  writer->flat = outer;
}

void pags_json_put_raw(pags_json_writer *writer, const char *key, const char *text) {
  begin_value(writer, key);
  for (size_t length; *text; text += length ? length : 1) {
    length = pags_text_utf8(text);
    if (length)
      put(writer, text, length);
    else
      put_stray(writer, *text);
  }
}

pags_result pags_json_writer_finish(pags_json_writer *writer) {
  assert(writer->depth == 0);
  put(writer, "\n", 1);
  return writer->failed ? pags_out_of_memory("%zu bytes of JSON", writer->size) : PAGS_OK;
}

pags_result pags_json_writer_save(pags_json_writer *writer, const char *path) {
  PAGS_TRY(pags_json_writer_finish(writer));
  return pags_file_write(path, writer->data, writer->size);
}

pags_result pags_json_writer_save_in_folder(pags_json_writer *writer, const char *folder, const char *name) {
  PAGS_AUTOFREE char *path = pags_path_join(folder, name);
  PAGS_CHECK_MEMORY(path, "%s", folder);
  return pags_json_writer_save(writer, path);
}
