/* SPDX-License-Identifier: Apache-2.0 */
/* The report of pags info about a scene folder or a splat file. */
#ifndef PAGS_CLI_SCENE_FACTS_H
#define PAGS_CLI_SCENE_FACTS_H

#include "cli/reading.h"
#include "cli/report.h"

#include <pags/dataset.h>

typedef struct pags_scene_facts_options {
  pags_tasks *tasks;
  bool memory;  /* render one frame and report the bytes per Gaussian of storage, rendering and training */
  bool objects; /* list every object */
  pags_reading reading;
} pags_scene_facts_options;

/* Loads the scene folder or splat file at `path` and adds its facts to the report. */
pags_result pags_scene_facts(pags_report *report, const char *path, const pags_scene_facts_options *options);

/* Name of an up axis: "+z", "-y", "+y" or "unknown". */
const char *pags_up_name(pags_up up);

#endif
