/* SPDX-License-Identifier: Apache-2.0 */
/* What a run leaves in its folder: log.jsonl, previews, the scene, report.json. */
#ifndef PAGS_TRAIN_OUTPUT_H
#define PAGS_TRAIN_OUTPUT_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/train.h>

#include "base/file.h"
#include "train/driving_losses.h"
#include "train/state.h"

typedef struct pags_output {
  char *folder;
  char *checkpoint, *log, *report; /* paths in it */
  int made;                        /* 1: the folder didn't exist */
  pags_file_writer lines;          /* of the log; its stream is NULL before open and after a failed line */
  bool begun;                      /* the log was opened */
} pags_output;

/* Looks, changes nothing: refuses a file, and a non-empty folder without resume or overwrite. `found` receives 1
 * where there is a checkpoint to resume. */
pags_result pags_output_find(pags_output *output, const pags_train_options *options, int *found);
/* Makes the folder and opens the log. A fresh run's removes what an earlier one of ours left; a resumed one's keeps
 * the lines up to `step`. */
pags_result pags_output_open(pags_output *output, int resumed, int64_t step);
/* With `failed`, a folder that this run made is removed again unless it holds a checkpoint. */
void pags_output_close(pags_output *output, int failed);

/* One line: no clock in it, so that logs of equal runs are equal. */
typedef struct pags_log_entry {
  int64_t step, gaussians;
  int level, sh_degree;
  double loss, psnr;                               /* running */
  double step_loss, step_l1, step_ssim, step_psnr; /* of this step's view */
  pags_driving_losses terms;                       /* the same */
  int64_t bad_rows;                                /* of the run so far */
} pags_log_entry;
pags_result pags_output_log(pags_output *output, const pags_log_entry *entry);
typedef struct pags_density_change { /* of all models together */
  int64_t cloned, split, pruned, wanted;
} pags_density_change;
pags_result pags_output_log_density(pags_output *output, int64_t step, const pags_density_change *change,
                                    int64_t gaussians);
pags_result pags_output_log_prune(pags_output *output, int64_t step, int64_t pruned, int64_t gaussians);

/* preview_STEP.png: the picture beside its photograph. */
pags_result pags_output_preview(const pags_output *output, int64_t step, const pags_picture *picture,
                                const pags_photo *photo);

/* scene.json and its PLYs; the state's parameters must be current. With sh_error the background has a PLY for each
 * degree that its rows need, and an object's is of the highest that one of its own does. */
pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state);
/* Bytes of what that writes as of now, but for the PLYs and for the name of the data set. */
pags_result pags_output_bytes(const pags_dataset *dataset, const pags_train_state *state, uint64_t *bytes);

pags_result pags_output_report(const pags_output *output, const pags_train_result *result, pags_tasks *tasks);

#endif
