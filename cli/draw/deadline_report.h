/* SPDX-License-Identifier: Apache-2.0 */
/* Renders frames within the time budget of --budget-ms (pags/deadline.h) and gathers statistics: frames within the
 * budget, quality steps, and the error of some frames against full quality. */
#ifndef PAGS_CLI_DEADLINE_REPORT_H
#define PAGS_CLI_DEADLINE_REPORT_H

#include "cli/common/session.h"

#include <pags/compose.h>
#include <pags/deadline.h>

typedef struct pags_deadline_error {
  double squared, samples, largest; /* of channels, clamped to 0..1 */
} pags_deadline_error;

typedef struct pags_deadline_report {
  pags_deadline *deadline;
  pags_deadline_controller controller;
  pags_frame *full_frame; /* renders the full-quality frames to compare with */
  float *priority;        /* per Gaussian id */
  int64_t ids;
  int check_every; /* compare every Nth frame with full quality */
  int64_t frames, met, checked;
  int64_t at_step[PAGS_DEADLINE_WHOLE_STEPS];
  double sum_ms, worst_ms, sum_full_tiles;
  pags_deadline_error all, critical; /* of pixels */
} pags_deadline_report;

/* Every `check_every`th frame is also drawn at full quality, outside of the timed part, to measure the error. The
 * composition must outlive the report. */
pags_result pags_deadline_report_create(const pags_composition *composition, pags_tasks *tasks, double ms,
                                        int check_every, pags_deadline_report *out);
void pags_deadline_report_destroy(pags_deadline_report *deadline); /* a zeroed struct is allowed */
pags_result pags_deadline_report_draw(pags_deadline_report *deadline, const pags_part *parts, int part_count,
                                      const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                      pags_deadline_result *report);

void pags_deadline_report_print(const pags_deadline_report *deadline, const pags_session *session);
/* Writes a JSON member "budget" with the statistics of all frames. */
void pags_deadline_report_put(const pags_deadline_report *deadline, pags_json_writer *json);
/* Writes the members of one frame into an open JSON object. */
void pags_deadline_report_put_frame(const pags_deadline_result *report, pags_json_writer *json);

#endif
