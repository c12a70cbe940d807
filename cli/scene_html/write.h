/* SPDX-License-Identifier: Apache-2.0 */
/* pags export SCENE scene.html: one file that shows a scene in any browser, by WebGL, without a network. */
#ifndef PAGS_CLI_SCENE_HTML_WRITE_H
#define PAGS_CLI_SCENE_HTML_WRITE_H

#include <pags/scene.h>
#include <pags/tasks.h>

typedef struct pags_html_settings {
  const char *name;     /* name of the scene */
  int sh_degree;        /* highest degree of harmonics, 0..3 */
  uint64_t target_size; /* maximum size of the file, bytes; 0: no limit */
  pags_tasks *tasks;
  pags_progress_fn *progress; /* NULL: none */
  void *user;
} pags_html_settings;

typedef struct pags_html_report {
  int64_t gaussians;   /* written */
  int64_t left_out;    /* visible Gaussians left out for the size */
  int sh_degree;       /* of what was written */
  int sh_degree_asked; /* what the scene and the settings would have given */
  double left;         /* share of all contributions that those left out had */
  uint64_t bytes;
} pags_html_report;

/* Writes the file, complete or not at all. Takes over the scene, which is zeroed, also on failure. For a target size,
 * degrees of harmonics are dropped first, then Gaussians, lowest contribution first; PAGS_ERROR_LIMIT if even a tenth
 * of them don't fit. Bit-identical for any number of threads. */
pags_result pags_html_write(pags_scene *scene, const char *path, const pags_html_settings *settings,
                            pags_html_report *report);

#endif
