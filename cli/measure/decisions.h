/* SPDX-License-Identifier: Apache-2.0 */
/* What a training decided to model, in words: the member "modelled" of scene.json (docs/scene-folder.md) with the times
 * of report.json, for pags info and reports. */
#ifndef PAGS_CLI_MEASURE_DECISIONS_H
#define PAGS_CLI_MEASURE_DECISIONS_H

#include "cli/common/report.h"

#include <pags/dataset.h>
#include "base/json.h"
#include "base/text.h"

/* The columns of a decision: whether the part is modelled ("yes", "no", "open", "degree 3"), what was measured, bytes
 * of the scene folder, time of the training, and the reason. "-": not known. */
typedef struct pags_decision_row {
  char modelled[24], measured[64], bytes[80], time[96], why[600];
} pags_decision_row;

/* Returns whether a note is the entry of a decision, and if so writes its row. `notes`: the whole member "modelled", of
 * which scenes of older versions have another form; `report`: the root of report.json, or NULL. */
bool pags_decision_read(const pags_json_value *notes, const pags_json_value *note, const pags_json_value *report,
                        pags_decision_row *out);

/* Adds all that training noted, whatever its keys, to a report: `notes` is JSON. `folder`: the scene's, whose
 * report.json has times, or NULL. */
pags_result pags_decisions_put(pags_report *report, const char *notes, const char *folder);

/* Adds what is known of a data set before a training with default options, in the same form; "modelled" is null where
 * the training decides. */
pags_result pags_decisions_put_ahead(pags_report *report, const pags_dataset *dataset);

/* A member of a JSON object that may be NULL; NaN without a number of that key. */
double pags_spoken_number(const pags_json_value *object, const char *key);
/* A JSON value in words, in `text` if it must be written: "yes" for true; "..." for an array or object. */
const char *pags_spoken_value(const pags_json_value *value, char text[PAGS_DOUBLE_TEXT]);
/* Joins the members or elements of a JSON value on one line, except the member with the key `but` (may be NULL). */
void pags_spoken_members(const pags_json_value *parent, const char *but, char *text, size_t size);

#endif
