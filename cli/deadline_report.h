/* SPDX-License-Identifier: Apache-2.0 */
/* Frames within --budget-ms: draws them one after another and holds some against full quality. */
#ifndef PAGS_CLI_DEADLINE_REPORT_H
#define PAGS_CLI_DEADLINE_REPORT_H

#include "cli/session.h"

#include <pags/compose.h>
#include <pags/deadline.h>

typedef struct pags_deadline_report {
  pags_deadline *budget;
  pags_frame *whole; /* full quality, to compare with */
  float *priority;   /* per id */
  int64_t ids;
  double ms;       /* the target */
  int check_every; /* frames */
  int64_t frames, met, checked;
  int64_t at_step[PAGS_DEADLINE_STEPS];
  double sum_ms, worst_ms, sum_full_tiles;
  double squared, samples, squared_critical, samples_critical, largest, largest_critical;
} pags_deadline_report;

/* Every `check_every`th frame is drawn in full as well, outside of the time. The composition must outlive it. */
pags_result pags_deadline_report_create(const pags_composition *composition, pags_tasks *tasks, double ms,
                                        int check_every, pags_deadline_report *out);
void pags_deadline_report_destroy(pags_deadline_report *deadline); /* a zeroed struct is allowed */
pags_result pags_deadline_report_draw(pags_deadline_report *deadline, const pags_part *parts, int part_count,
                                      const pags_camera *camera, const pags_frame_options *options, pags_picture *out,
                                      pags_deadline_result *report);

void pags_deadline_report_print(const pags_deadline_report *deadline, const pags_session *session);
void pags_deadline_report_put(const pags_deadline_report *deadline, pags_json_writer *json); /* a member "budget" */
void pags_deadline_report_put_frame(const pags_deadline_result *report,
                                    pags_json_writer *json); /* members of a frame */

#endif
