/* SPDX-License-Identifier: Apache-2.0 */
/* Names the splat formats of other programs that PAGS does not read, and what to do with such a file. */
#ifndef PAGS_SCENE_UNREAD_SPLATS_H
#define PAGS_SCENE_UNREAD_SPLATS_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/json.h"

/* Fails with PAGS_ERROR_UNSUPPORTED if the file is in one of these formats: by its first bytes, by the keys of its
 * JSON, else by its extension. Returns PAGS_OK otherwise. `bytes` may be NULL (with size 0) and `root` may be NULL,
 * where the content is not known. */
pags_result pags_unread_splats_refuse(const char *path, const uint8_t *bytes, size_t size, const pags_json_value *root);

/* The same for a folder, by the names of its files. */
pags_result pags_unread_splats_refuse_folder(const char *folder);

#endif
