/* SPDX-License-Identifier: Apache-2.0 */
/* Names the formats of other programs that are not read, with the way from each to a COLMAP model, which is. */
#ifndef PAGS_DATASET_FOREIGN_H
#define PAGS_DATASET_FOREIGN_H

#include <stdbool.h>

#include <pags/base.h>

#include "base/json.h"

/* Whether a file is one of another program by its name. */
bool pags_foreign_knows(const char *path);

/* Fails: `path`, a file or folder, is no data set. The message names the program whose files it holds and what would
 * do; where nothing is known of it, what a data set is and the command that makes one of pictures. */
pags_result pags_foreign_refuse(const char *path);

/* The same for a JSON file that is no transforms file, by its keys. */
pags_result pags_foreign_refuse_json(const pags_json *json);

#endif
