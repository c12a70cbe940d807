/* SPDX-License-Identifier: Apache-2.0 */
/* Reader of .npz files: zip archives (base/zip.h) of .npy members, stored, not deflated, that hold little-endian
 * float32 in C order. */
#ifndef PAGS_EVAL_NPZ_H
#define PAGS_EVAL_NPZ_H

#include <pags/base.h>

enum { PAGS_NPZ_MAX_RANK = 8 };

typedef struct pags_npz_array {
  char *name; /* without ".npy" */
  int rank;   /* 0..8 */
  int64_t shape[PAGS_NPZ_MAX_RANK];
  int64_t count; /* product of the shape */
  float *data;
} pags_npz_array;

typedef struct pags_npz {
  int64_t count;
  pags_npz_array *arrays;
} pags_npz;

/* Reads all arrays of a file. Errors: PAGS_ERROR_IO, _FORMAT, _UNSUPPORTED (compressed, encrypted, zip64, other
 * element types), _MEMORY. `out` is zeroed on failure. */
pags_result pags_npz_load(const char *path, pags_npz *out);
/* Reads all arrays of a file that is in memory; `path` is only named in error messages. */
pags_result pags_npz_parse(const uint8_t *bytes, size_t size, const char *path, pags_npz *out);
void pags_npz_destroy(pags_npz *npz); /* frees and zeroes */

/* Returns the array of that name, NULL if not found. */
const pags_npz_array *pags_npz_find(const pags_npz *npz, const char *name);

#endif
