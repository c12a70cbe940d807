/* SPDX-License-Identifier: Apache-2.0 */
/* Saves Gaussians as SPZ. */
#ifndef PAGS_FORMAT_SPZ_SAVE_H
#define PAGS_FORMAT_SPZ_SAVE_H

#include <pags/scene.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_spz_options {
  int version;                   /* 3 (gzip) or 4 (zstd) */
  int axes;                      /* a pags_axes of the first eight: the axes of the file */
  const pags_splat_facts *facts; /* antialiased, up and origin of the scene; NULL: nothing is known of them */
} pags_spz_options;

/* Saves Gaussians. Reports values beyond the format's range in the log, one line per kind. */
pags_result pags_spz_save(const char *path, const pags_gaussians *g, const pags_spz_options *options);

#ifdef __cplusplus
}
#endif
#endif
