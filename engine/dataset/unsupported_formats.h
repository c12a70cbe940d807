/* SPDX-License-Identifier: Apache-2.0 */
/* Names the formats of other programs that can't be opened as they are, with the way from each to one that can: the
 * table of unsupported_formats.c. For splat files see scene/other_formats.h. */
#ifndef PAGS_DATASET_UNSUPPORTED_FORMATS_H
#define PAGS_DATASET_UNSUPPORTED_FORMATS_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/json.h"

/* Whether a file is one of another program by its name. */
bool pags_unsupported_knows(const char *path);

/* Fails: `path`, a file or folder, is no data set. The message names the program whose files it holds and what would
 * do; where nothing is known of it, what a data set is and the command that makes one of pictures. */
pags_result pags_unsupported_refuse(const char *path);

/* The same for a JSON file that is no transforms file, by its keys. */
pags_result pags_unsupported_refuse_json(const pags_json *json);

/* Fails with PAGS_ERROR_UNSUPPORTED and a message that names the format and what would do if the file or folder is of
 * a recording that has no reader, or (`importers`) that an importer reads; PAGS_OK if it is not one of those known. */
pags_result pags_unsupported_recording_check(const char *path, bool importers);

#endif
