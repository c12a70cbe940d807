/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets, one for each reader, in one source for each group of readers, on top of the drivers in fuzz.c.
 * See docs/reliability.md for running and adding them.
 *
 * A target supplies valid files as seeds, accepts any bytes and must return: its input is either refused with a
 * message, or gives a result with the reader's guarantees. A check that fails calls FUZZ_CHECK, which stops the
 * program. */
#ifndef PAGS_TESTS_FUZZ_H
#define PAGS_TESTS_FUZZ_H

#include <stddef.h>
#include <stdint.h>

#include <pags/base.h>
#include <pags/gaussians.h>

#include "splat_files.h"

typedef struct fuzz_target {
  const char *name;
  void (*seeds)(void); /* passes the target's valid files to fuzz_seed */
  /* Returns 1 if the input was accepted, 0 if refused. `data` has no bytes beyond `size`. */
  int (*run)(const uint8_t *data, size_t size);
  /* Corrects checksums in place after a mutation, so that mutations aren't refused because of them; returns the
   * size, at most `capacity`. NULL: the format has no checksums. It is left out for some inputs, to try wrong checksums
   * as well. */
  size_t (*mend)(uint8_t *data, size_t size, size_t capacity);
  const char *const *words; /* keywords of the format, NULL last; NULL: none */
  /* Limit of one allocation by the reader in bytes: memory + times * size. Defaults for 0: 1 MiB and 64. */
  size_t memory, times;
  /* 1: nested parts begin with their lengths, so seven of eight mutations of the smoke run keep the size. */
  int nested;
  int smoke; /* number of inputs of the smoke run; 0: 10000 */
} fuzz_target;

/* The targets of the group; NULL last. */
extern const fuzz_target *const fuzz_targets[];

/* Adds a valid file, which the target must accept. */
void fuzz_seed(const void *bytes, size_t size);
void fuzz_seed_text(const char *text);
/* Adds a valid file and frees its bytes. */
void fuzz_seed_bytes(file_bytes bytes);
/* Adds the file at `path`, which a writer has just written with the result `saved`. */
void fuzz_seed_saved(pags_result saved, const char *path);

/* This line separates several files in one input. fuzz_parts copies each into a separate block with a zero byte
 * after its end, as pags_file_read does. Missing files are NULL. fuzz_parts_free frees them. */
#define FUZZ_CUT "\n=8<=\n"
typedef struct fuzz_part {
  uint8_t *bytes;
  size_t size;
} fuzz_part;
void fuzz_parts(const uint8_t *data, size_t size, int count, fuzz_part *parts);
void fuzz_parts_free(int count, fuzz_part *parts);

/* Writes a file of that name in the target's own folder and returns its path, valid until four more calls;
 * NULL bytes: removes the file. Folders in `name` are created. */
const char *fuzz_file(const char *name, const void *bytes, size_t size);
const char *fuzz_folder(void);

/* Checks a refusal: stops the program unless its message begins with `name` or contains it. */
void fuzz_refused(pags_result result, const char *name);

/* Handles the result of a target that reads Gaussians: checks the reader's guarantees for an accepted file, or the
 * message of a refusal, and destroys the Gaussians. */
int fuzz_gaussians(pags_result result, pags_gaussians *g, const char *name);

__attribute__((noreturn)) void fuzz_stop(const char *file, int line, const char *what);
#define FUZZ_CHECK(condition) ((condition) ? (void)0 : fuzz_stop(__FILE__, __LINE__, #condition))

#endif
