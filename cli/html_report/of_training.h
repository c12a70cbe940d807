/* SPDX-License-Identifier: Apache-2.0 */
/* The report that pags train leaves in the scene's folder, and the command line in it. */
#ifndef PAGS_CLI_HTML_REPORT_OF_TRAINING_H
#define PAGS_CLI_HTML_REPORT_OF_TRAINING_H

#include "cli/html_report/html_report.h"

#include <pags/train.h>

/* Writes report.html into the folder of a scene that was just trained. It takes at most a thirtieth of the training's
 * time, at least a second and at most ten, for the views, and a second after a training that was stopped. A page that
 * can't be written is a warning: the scene is complete without it. */
void pags_html_report_of_training(const pags_session *session, const char *scene,
                                  const pags_dataset_options *dataset_options, const pags_train_result *result);

/* Joins the words of a command as a shell takes them: "pags VERB ...". The caller frees it; NULL if out of memory. */
char *pags_command_line(const char *verb, int argc, char *const *argv);

#endif
