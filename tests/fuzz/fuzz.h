/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets: one a reader, in a file a group of readers, over the drivers in fuzz.c. docs/reliability.md says how to
 * run and add them.
 *
 * A target gives valid files as seeds, takes any bytes, and must return: what it is given either is refused with a
 * message or gives what its reader promises. A check that fails calls FUZZ_CHECK, which stops the program. */
#ifndef PAGS_TESTS_FUZZ_H
#define PAGS_TESTS_FUZZ_H

#include <stddef.h>
#include <stdint.h>

#include <pags/base.h>

#include "splat_files.h"

typedef struct fuzz_target {
  const char *name;
  void (*seeds)(void);                          /* hands its files to fuzz_seed */
  int (*run)(const uint8_t *data, size_t size); /* 1: was accepted, 0: refused. `data` has no byte beyond `size` */
  /* Puts checksums right after a mutation, in place, so that mutations get past them; returns the size, at most
     `capacity`. NULL: there are none. Now and then it isn't called, so that wrong ones are tried as well. */
  size_t (*mend)(uint8_t *data, size_t size, size_t capacity);
  const char *const *words; /* of the format, NULL last; NULL: none */
  /* Bytes that may be live at once: memory + times * size. 0: 1 MiB, 64 */
  size_t memory, times;
  int nested; /* parts begin with their lengths: the smoke run's mutations keep the size, seven of eight */
  int smoke;  /* inputs of the smoke run; 0: 10000 */
} fuzz_target;

/* Of the group; NULL last. */
extern const fuzz_target *const fuzz_targets[];

/* A valid file. The target must accept it. */
void fuzz_seed(const void *bytes, size_t size);
void fuzz_seed_text(const char *text);
/* Takes over a maker's bytes. */
void fuzz_seed_bytes(file_bytes bytes);
/* A file that `saved` says was written. */
void fuzz_seed_saved(pags_result saved, const char *path);

/* Parts of one input are parted by this line; `parts` receives each as a block of its own with a zero byte after its
 * end, as pags_file_read would leave it. Missing ones are NULL. fuzz_parts_free frees them. */
#define FUZZ_CUT "\n=8<=\n"
typedef struct fuzz_part {
  uint8_t *bytes;
  size_t size;
} fuzz_part;
void fuzz_parts(const uint8_t *data, size_t size, int count, fuzz_part *parts);
void fuzz_parts_free(int count, fuzz_part *parts);

/* Writes a file of that name in the target's own folder and returns its path, good until the fourth call from now; NULL
 * bytes: removes it. Folders within `name` are made. */
const char *fuzz_file(const char *name, const void *bytes, size_t size);
const char *fuzz_folder(void);

/* A refusal must say so: stops unless there is a message that begins with or holds `name`. */
void fuzz_refused(pags_result result, const char *name);

__attribute__((noreturn)) void fuzz_stop(const char *file, int line, const char *what);
#define FUZZ_CHECK(condition) ((condition) ? (void)0 : fuzz_stop(__FILE__, __LINE__, #condition))

#endif
