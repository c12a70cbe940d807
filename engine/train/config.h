/* SPDX-License-Identifier: Apache-2.0 */
/* The training configuration as text: name=value lines for checkpoints, a JSON object for scene.json. Also resolves
 * fields left to automatic choice and compares configurations. */
#ifndef PAGS_TRAIN_CONFIG_H
#define PAGS_TRAIN_CONFIG_H

#include <pags/train.h>
#include <stdbool.h>

/* Largest number of steps of a run. Each model's optimiser allocates 16 bytes per step, so the limit also bounds the
 * memory that a damaged checkpoint can ask for. */
enum { PAGS_CONFIG_STEPS = 10000000 };

/* The table of fields (fields.c), read by the functions of <pags/train.h>. */
extern const pags_train_field pags_fields[];
extern const int pags_field_count;

/* Size in bytes of a buffer that holds a configuration as text, in either form. */
enum { PAGS_CONFIG_TEXT = 8192 };

/* Writes every field as "name=value\n". */
void pags_config_write(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]);
/* Reads what pags_config_write wrote; `where` names the source in error messages. */
pags_result pags_config_read(pags_train_config *config, const char *text, size_t size, const char *where);
/* Writes every field as a JSON object in one line. */
void pags_config_write_json(const pags_train_config *config, char text[PAGS_CONFIG_TEXT]);
/* Returns `config` with the fields that are set to auto filled in; some depend on whether the data set is a driving
 * set. */
pags_train_config pags_config_resolve(const pags_train_config *config, bool driving);
/* Returns the name of the first field that differs between `a` and `b`, iterations and schedule_iterations left out;
 * NULL if none does. */
const char *pags_config_difference(const pags_train_config *a, const pags_train_config *b);

#endif
