/* SPDX-License-Identifier: Apache-2.0 */
/* A temporary folder for the files of one test, and functions that write files into it. */
#ifndef PAGS_TESTS_UNIT_SCRATCH_H
#define PAGS_TESTS_UNIT_SCRATCH_H

#include <pags/image.h>

#include "base/file.h"
#include "system.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

typedef struct scratch {
  char folder[160];
  char path[256]; /* result of the last call of scratch_path */
} scratch;

/* Fails with the message unless `result` is PAGS_OK. */
static inline void scratch_ok(pags_result result) {
  if (result != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

static inline void scratch_begin(scratch *s) {
  assert_true(system_make_scratch(s->folder, sizeof s->folder));
}

static inline void scratch_end(scratch *s) {
  scratch_ok(pags_remove_tree(s->folder));
}

/* Registers a test whose state is the scratch folder. */
#define scratch_test(f) cmocka_unit_test_setup_teardown(f, scratch_setup, scratch_teardown)

static inline int scratch_setup(void **state) {
  static scratch s;
  scratch_begin(&s);
  *state = &s;
  return 0;
}

static inline int scratch_teardown(void **state) {
  scratch_end(*state);
  return 0;
}

static inline const char *scratch_path(scratch *s, const char *name) {
  snprintf(s->path, sizeof s->path, "%s/%s", s->folder, name);
  return s->path;
}

static inline void scratch_write(scratch *s, const char *name, const void *bytes, size_t size) {
  char *folder = pags_path_folder(scratch_path(s, name));
  scratch_ok(pags_make_dirs(folder));
  free(folder);
  scratch_ok(pags_file_write(s->path, bytes, size));
}

static inline void scratch_text(scratch *s, const char *name, const char *text) {
  scratch_write(s, name, text, strlen(text));
}

/* Saves the image under the name and destroys it. */
static inline void scratch_image(scratch *s, const char *name, pags_image *image) {
  char *folder = pags_path_folder(scratch_path(s, name));
  scratch_ok(pags_make_dirs(folder));
  free(folder);
  scratch_ok(pags_image_save(scratch_path(s, name), image));
  pags_image_destroy(image);
}

/* Saves an 8-bit RGB picture whose samples are paint(x, y, c). */
static inline void scratch_picture(scratch *s, const char *name, int width, int height,
                                   uint8_t (*paint)(int x, int y, int c)) {
  pags_image image;
  assert_int_equal(pags_image_create(&image, width, height, 3, PAGS_U8), PAGS_OK);
  uint8_t *out = image.data;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      for (int c = 0; c < 3; c++)
        *out++ = paint(x, y, c);
  scratch_image(s, name, &image);
}

/* Fails unless `result` is `code` and the error message is one line that contains `part`. */
static inline void scratch_expect(pags_result result, pags_result code, const char *part) {
  const char *message = pags_error_message();
  if (result != code || !strstr(message, part) || strchr(message, '\n'))
    fail_msg("expected %s with '%s', found %s: %s", pags_result_name(code), part, pags_result_name(result), message);
}

#endif
