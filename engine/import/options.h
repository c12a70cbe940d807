/* SPDX-License-Identifier: Apache-2.0 */
/* Parsing of options, shared by all importers. */
#ifndef PAGS_IMPORT_OPTIONS_H
#define PAGS_IMPORT_OPTIONS_H

#include <pags/base.h>
#include <pags/import.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Parses a list of camera numbers like "0,2,1" into ascending, unique numbers below `limit` (at most 16). `text`
 * NULL: the first `usual` cameras. */
pags_result pags_import_cameras(const char *text, int limit, int usual, int numbers[16], int *count);

/* Clips [frame_first, frame_last] to the `count` frames of the source; PAGS_ERROR_ARGUMENT if no frame is left or
 * first is above last. */
pags_result pags_import_frames(const pags_import_options *options, int64_t count, int64_t *first, int64_t *last);

#ifdef __cplusplus
}
#endif
#endif
