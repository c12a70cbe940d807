/* SPDX-License-Identifier: Apache-2.0 */
/* pags info --sheet: a data set as one picture, by which frames and cameras are chosen: small photographs and, below
 * them, a map. */
#ifndef PAGS_CLI_SHEET_H
#define PAGS_CLI_SHEET_H

#include "cli/common/report.h"

#include <pags/dataset.h>

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
