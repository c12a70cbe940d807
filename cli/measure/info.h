/* SPDX-License-Identifier: Apache-2.0 */
/* What pags info prints and writes: facts of scenes and splat files, the overlay and the contact sheet of data sets. */
#ifndef PAGS_CLI_MEASURE_INFO_H
#define PAGS_CLI_MEASURE_INFO_H

#include "cli/common/report.h"
#include "cli/common/scene_options.h"

#include <pags/dataset.h>

typedef struct pags_scene_facts_options {
  pags_tasks *tasks;
  bool memory;  /* render one frame and report the bytes per Gaussian of storage, rendering and training */
  bool objects; /* list every object */
  pags_reading reading;
} pags_scene_facts_options;

/* Loads the scene folder or splat file at `path` and adds its facts to the report. */
pags_result pags_scene_facts(pags_report *report, const char *path, const pags_scene_facts_options *options);

/* Counts the Gaussians of each object: those of its own model, or those of the background that carry its number. The
 * caller frees *out. PAGS_ERROR_MEMORY; then *out is NULL. */
pags_result pags_scene_object_gaussians(const pags_scene *scene, int64_t **out);

/* Name of an up axis: "+z", "-y", "+y" or "unknown". */
const char *pags_up_name(pags_up up);

/* ---- pags info --overlay: boxes and LiDAR on the photographs of a driving set ---- */

/* Writes the annotated photographs of at most twenty evenly chosen time steps into `folder` (NAME.jpg, folder made if
 * missing). Adds a report group "overlay" with figures of agreement, measured on the same photographs, and a list
 * "warnings". Returns PAGS_ERROR_ARGUMENT for static sets. */
pags_result pags_overlay(const pags_dataset *dataset, const char *folder, pags_session *session, pags_report *report);

/* ---- pags info --sheet: a contact sheet with a map ---- */

/* Writes `file` (PNG or JPEG by its extension), 1,600 pixels wide. Photographs: for a driving set one row per camera
 * (at most 12) with its number, and at most 8 time steps with their numbers; for a static set at most 32 views with
 * their numbers, evenly spaced. The map looks down along the up axis; the longest extent of the path is horizontal. It
 * shows cameras (blue; held out: red), numbers and view cones at the steps of the photographs, moving objects at these
 * steps by category with a stroke to their front, parked objects (grey), LiDAR of these steps or the points of the data
 * set, and a scale bar in metres (static sets: world units).  Adds a report group "sheet" with the file and the meaning
 * of the numbers. PAGS_ERROR_IO, PAGS_ERROR_FORMAT (a photograph), PAGS_ERROR_ARGUMENT (the extension),
 * PAGS_ERROR_MEMORY, PAGS_CANCELLED. */
pags_result pags_sheet(const pags_dataset *dataset, const char *file, const pags_session *session, pags_report *report);

#endif
