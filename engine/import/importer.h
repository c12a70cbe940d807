/* SPDX-License-Identifier: Apache-2.0 */
/* Shared by the importers: parsing of options, and optional inputs that are there in another form than the importer
 * reads: packed, of another ending, in other letters. Passed over, they would look like inputs that are missing. */
#ifndef PAGS_IMPORT_IMPORTER_H
#define PAGS_IMPORT_IMPORTER_H

#include <pags/base.h>
#include <pags/import.h>

/* Parses a list of camera numbers like "0,2,1" into ascending, unique numbers below `limit` (at most 16). `text`
 * NULL: the first `usual` cameras. */
pags_result pags_import_cameras(const char *text, int limit, int usual, int numbers[16], int *count);

/* Clips [frame_first, frame_last] to the `count` frames of the source; PAGS_ERROR_ARGUMENT if no frame is left or
 * first is above last. */
pags_result pags_import_frames(const pags_import_options *options, int64_t count, int64_t *first, int64_t *last);

/* PAGS_ERROR_FORMAT if `folder` lacks `name`, but has it in another form; `what` is read from it, in the plural. */
pags_result pags_other_form_check(const char *folder, const char *name, const char *what);
/* PAGS_ERROR_FORMAT if the folder is there and has files, but none that ends in `extension`. */
pags_result pags_other_files_check(const char *folder, const char *extension, const char *what);

#endif
