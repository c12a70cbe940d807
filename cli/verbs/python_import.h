/* SPDX-License-Identifier: Apache-2.0 */
/* Recordings that the Python package pags_recordings imports (tools/recordings). */
#ifndef PAGS_CLI_PYTHON_IMPORT_H
#define PAGS_CLI_PYTHON_IMPORT_H

#include <pags/import.h>
#include <stdbool.h>

/* The kinds it has, as a sentence names them. */
#define PAGS_PYTHON_IMPORT_KINDS "argoverse2, nuscenes, pandaset, waymo2, kitti360, ncore or photos"

bool pags_python_import_knows(const char *kind);

/* `pictures`: of kind photos, how many are taken at most; 0: the package's default. Goes on as the package's program,
 * which lies beside this program or is installed for Python in the same version. Returns only where it couldn't be
 * started: PAGS_ERROR_UNSUPPORTED with what to do, PAGS_ERROR_MEMORY. */
pags_result pags_python_import(const char *kind, const char *source, const char *folder,
                               const pags_import_options *options, int pictures, const char *json, bool quiet);

#endif
