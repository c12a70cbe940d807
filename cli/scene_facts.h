/* SPDX-License-Identifier: Apache-2.0 */
/* What pags info says of a scene. */
#ifndef PAGS_CLI_SCENE_FACTS_H
#define PAGS_CLI_SCENE_FACTS_H

#include "cli/report.h"

#include <pags/dataset.h>

typedef struct pags_scene_facts_options {
  pags_tasks *tasks;
  bool memory;  /* render one frame and say what each stage holds */
  bool objects; /* list every object */
} pags_scene_facts_options;

/* Loads the scene folder or splat file; `kind` is what it is called. */
pags_result pags_scene_facts(pags_report *report, const char *path, const char *kind,
                             const pags_scene_facts_options *options);

/* "+z", "-y", "unknown" */
const char *pags_up_name(pags_up up);

#endif
