/* SPDX-License-Identifier: Apache-2.0 */
/* Writes report.html: one page on a scene, or on two of them side by side, that needs no other file and no script. */
#ifndef PAGS_CLI_HTML_REPORT_HTML_REPORT_H
#define PAGS_CLI_HTML_REPORT_HTML_REPORT_H

#include <pags/train.h>
#include "cli/common/progress.h"
#include "cli/common/session.h"

#include <pags/dataset.h>
#include <pags/eval.h>

enum { PAGS_REPORT_PICTURES = 48 }; /* views shown unless a number is given: a page of about 2 MB */

typedef struct pags_html_report_settings {
  const char *scenes[2]; /* folders, or splat files */
  int count;             /* 1 or 2 */
  const char *dataset;   /* compare with the photographs of this data set, which must be there; NULL: the scenes' own */
  pags_dataset_options dataset_options;
  int64_t pictures;            /* views that are shown as pictures, at most */
  double seconds;              /* time limit for rendering views, seconds; the remaining views are named. 0: no limit */
  const pags_session *session; /* its threads; with --strict a warning about a scene leaves the page unwritten */
  pags_progress *progress;
  const pags_lpips *lpips;    /* NULL: none */
  const volatile int *cancel; /* a non-zero value ends the work; NULL: none */
} pags_html_report_settings;

typedef struct pags_html_report_facts {
  int64_t views, measured, pictures; /* held-out views; measured ones; ones with pictures */
  double psnr, ssim, lpips;          /* means over the held-out views that were measured; NaN: none was */
} pags_html_report_facts;

/* Writes the page to `output`; nothing is written on failure. `facts` has room for settings->count. PAGS_CANCELLED if
 * it was cancelled. */
pags_result pags_html_report_write(const pags_html_report_settings *settings, const char *output,
                                   pags_html_report_facts *facts);

/* ---- The report at the end of pags train ---- */

/* Writes report.html into the folder of a scene that was just trained. It takes at most a thirtieth of the training's
 * time, at least a second and at most ten, for the views, and a second after a training that was stopped. A page that
 * can't be written is a warning: the scene is complete without it. */
void pags_html_report_of_training(const pags_session *session, const char *scene,
                                  const pags_dataset_options *dataset_options, const pags_train_result *result);

/* Joins the words of a command, quoted for a shell: "pags VERB ...". The caller frees it; NULL if out of memory. */
char *pags_command_line(const char *verb, int argc, char *const *argv);

#endif
