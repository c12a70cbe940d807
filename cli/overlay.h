/* SPDX-License-Identifier: Apache-2.0 */
/* Boxes and LiDAR drawn onto a data set's photographs, and how well the three agree: a look at its conventions. */
#ifndef PAGS_CLI_OVERLAY_H
#define PAGS_CLI_OVERLAY_H

#include "cli/report.h"

#include <pags/dataset.h>

/* Draws the photographs of at most twenty time steps, evenly chosen, into `folder` (NAME.jpg, made if missing) and adds
 * a group "overlay" of what they say, measured on the same photographs, with a list "warnings". PAGS_ERROR_ARGUMENT for
 * static sets. */
pags_result pags_overlay(const pags_dataset *dataset, const char *folder, const pags_session *session,
                         pags_report *report);

#endif
