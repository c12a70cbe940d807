/* SPDX-License-Identifier: Apache-2.0 */
/* Names recordings in formats that can't be opened as they are, and what would do. */
#ifndef PAGS_DATASET_FOREIGN_RECORDING_H
#define PAGS_DATASET_FOREIGN_RECORDING_H

#include <pags/base.h>
#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Fails with PAGS_ERROR_UNSUPPORTED and a message that names the format and what would do if the file or folder is of
 * a recording that has no reader, or (`importers`) that an importer reads; PAGS_OK if it is not one of those known. */
pags_result pags_foreign_recording_check(const char *path, bool importers);

#ifdef __cplusplus
}
#endif
#endif
