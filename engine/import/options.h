/* SPDX-License-Identifier: Apache-2.0 */
/* What importers share in reading their options. */
#ifndef PAGS_IMPORT_OPTIONS_H
#define PAGS_IMPORT_OPTIONS_H

#include <pags/base.h>
#include <pags/import.h>

#ifdef __cplusplus
extern "C" {
#endif

/* "0,2,1" -> numbers in rising order, each once, below `limit` (at most 16); NULL text: the first `usual`. */
pags_result pags_import_cameras(const char *text, int limit, int usual, int numbers[16], int *count);

/* Clips [frame_first, frame_last] to the `count` frames there are; PAGS_ERROR_ARGUMENT when nothing is left or ends
 * are swapped. */
pags_result pags_import_frames(const pags_import_options *options, int64_t count, int64_t *first, int64_t *last);

#ifdef __cplusplus
}
#endif
#endif
