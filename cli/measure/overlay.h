/* SPDX-License-Identifier: Apache-2.0 */
/* pags info --overlay: draws object boxes and LiDAR points onto a driving set's photographs and measures how well the
 * three agree, to check the set's conventions. */
#ifndef PAGS_CLI_OVERLAY_H
#define PAGS_CLI_OVERLAY_H

#include "cli/common/report.h"

#include <pags/dataset.h>

/* Writes the annotated photographs of at most twenty evenly chosen time steps into `folder` (NAME.jpg, folder made if
 * missing). Adds a report group "overlay" with figures of agreement, measured on the same photographs, and a list
 * "warnings". Returns PAGS_ERROR_ARGUMENT for static sets. */
pags_result pags_overlay(const pags_dataset *dataset, const char *folder, pags_session *session, pags_report *report);

#endif
