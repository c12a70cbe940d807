/* SPDX-License-Identifier: Apache-2.0 */
/* The configuration as text: for checkpoints (name=value lines) and scene.json (a JSON object). */
#ifndef PAGS_TRAIN_CONFIG_H
#define PAGS_TRAIN_CONFIG_H

#include <pags/train.h>
#include <stdbool.h>
#include "train/fields.h"

/* Most bytes a configuration takes as text, either way. */
enum { PAGS_CONFIG_TEXT = 8192 };

/* Every field as "name=value\n". */
void pags_config_write(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]);
/* The way back; `where` names the source in messages. */
pags_result pags_config_read(pags_train_config *config, const char *text, size_t size, const char *where);
/* The same as a JSON object in one line. */
void pags_config_write_json(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]);
/* `config` with what it leaves to the kind of data set filled in. */
pags_train_config pags_config_resolve(const pags_train_config *config, bool driving);
/* Name of the first field that differs, iterations and schedule_iterations left out; NULL when none does. */
const char *pags_config_difference(const pags_train_config *a, const pags_train_config *b);

#endif
