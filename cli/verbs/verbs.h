/* SPDX-License-Identifier: Apache-2.0 */
/* The verbs of pags: each takes its arguments (without program and verb) and returns the exit code. */
#ifndef PAGS_CLI_VERBS_H
#define PAGS_CLI_VERBS_H

#include <pags/import.h>
#include <stdbool.h>

int pags_verb_train(int argc, char **argv);
int pags_verb_render(int argc, char **argv);
int pags_verb_eval(int argc, char **argv);
int pags_verb_export(int argc, char **argv);
int pags_verb_info(int argc, char **argv);
int pags_verb_import(int argc, char **argv);
int pags_verb_synth(int argc, char **argv);
int pags_verb_split(int argc, char **argv);
int pags_verb_merge(int argc, char **argv);
int pags_verb_report(int argc, char **argv);
int pags_verb_view(int argc, char **argv);

/* ---- Imports by the Python package pags_recordings (tools/recordings) ---- */

/* Its kinds, as listed in messages. */
#define PAGS_PYTHON_IMPORT_KINDS "argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore or photos"

bool pags_python_import_knows(const char *kind);

/* Replaces this program by the package's: the one next to this program, or the installed one of the same version.
 * `pictures`: for kind photos, maximum number of photographs; 0: the package's default. Returns only if it can't be
 * started: PAGS_ERROR_UNSUPPORTED with the remedy, PAGS_ERROR_MEMORY. */
pags_result pags_python_import(const char *kind, const char *source, const char *folder,
                               const pags_import_options *options, int pictures, const char *json, bool quiet);

#endif
