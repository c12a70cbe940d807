/* SPDX-License-Identifier: Apache-2.0 */
/* The report of pags info about a scene folder or a splat file. */
#ifndef PAGS_CLI_SCENE_FACTS_H
#define PAGS_CLI_SCENE_FACTS_H

#include "cli/common/reading.h"
#include "cli/common/report.h"

#include <pags/dataset.h>
#include "base/json.h"
#include "base/text.h"

typedef struct pags_scene_facts_options {
  pags_tasks *tasks;
  bool memory;  /* render one frame and report the bytes per Gaussian of storage, rendering and training */
  bool objects; /* list every object */
  pags_reading reading;
} pags_scene_facts_options;

/* Loads the scene folder or splat file at `path` and adds its facts to the report. */
pags_result pags_scene_facts(pags_report *report, const char *path, const pags_scene_facts_options *options);

/* Counts the Gaussians of each of the scene's objects: of its own model, or of the background's those that carry its
 * number. The caller frees *out. PAGS_ERROR_MEMORY; then *out is NULL. */
pags_result pags_scene_object_gaussians(const pags_scene *scene, int64_t **out);

/* A JSON value in words, in `text` if it must be written: "yes" for true; "..." for an array or object. */
const char *pags_spoken_value(const pags_json_value *value, char text[PAGS_DOUBLE_TEXT]);
/* Joins the members or elements of a JSON value on one line, except the member with the key `but` (may be NULL). */
void pags_spoken_members(const pags_json_value *parent, const char *but, char *text, size_t size);

/* Name of an up axis: "+z", "-y", "+y" or "unknown". */
const char *pags_up_name(pags_up up);

#endif
