/* SPDX-License-Identifier: Apache-2.0 */
/* What pags info prints and writes: facts of scenes and splat files, the overlay and the contact sheet of data sets. */
#ifndef PAGS_CLI_MEASURE_INFO_H
#define PAGS_CLI_MEASURE_INFO_H

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

/* ---- pags info --overlay: boxes and LiDAR on the photographs of a driving set ---- */

/* Writes the annotated photographs of at most twenty evenly chosen time steps into `folder` (NAME.jpg, folder made if
 * missing). Adds a report group "overlay" with figures of agreement, measured on the same photographs, and a list
 * "warnings". Returns PAGS_ERROR_ARGUMENT for static sets. */
pags_result pags_overlay(const pags_dataset *dataset, const char *folder, pags_session *session, pags_report *report);

/* ---- pags info --sheet: a contact sheet with a map ---- */

/* Writes `file` (PNG or JPEG by its ending), 1,600 pixels wide. Photographs: of a driving set a row a camera (at most
 * 12), its number at the left, with at most 8 time steps, their numbers in the corners; of a static set at most 32
 * views, evenly chosen, with their numbers. The map looks down along the set's up axis, the path's longest way to the
 * right: cameras blue, held-out ones red, numbers and a view cone at the steps of the photographs, moving objects at
 * these steps by category with a stroke to their front, parked ones grey, LiDAR of these steps or the
 * points of the data set, a scale bar in metres (of a static set in units of its world).
 *
 * Adds a report group "sheet" with the file and what the numbers stand for. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (a
 * photograph), PAGS_ERROR_ARGUMENT (the ending), PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_sheet(const pags_dataset *dataset, const char *file, const pags_session *session, pags_report *report);

#endif
