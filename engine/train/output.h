/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the output folder of a training run: log.jsonl, previews, the scene, report.json. The checkpoint, in the
 * same folder, is written by checkpoint.c. */
#ifndef PAGS_TRAIN_OUTPUT_H
#define PAGS_TRAIN_OUTPUT_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/scene.h>
#include <pags/train.h>

#include "base/file.h"
#include "train/driving_losses.h"
#include "train/state.h"

typedef struct pags_output {
  char *folder;
  char *checkpoint, *log, *report; /* paths in the folder */
  struct pags_lock *lock;          /* of the folder, on rank 0; NULL on others */
  pags_file_writer lines;          /* writes the log; its stream is NULL before open and after a line failed */
  bool begun;                      /* the log has been opened */
} pags_output;

/* Locks the output folder and examines it without changing it: fails if it is a file, if another process writes there,
 * or if it isn't empty and neither resume nor overwrite is set. `found` receives 1 if there is a checkpoint to resume.
 */
pags_result pags_output_find(pags_output *output, const pags_train_options *options, int *found);
/* Creates the folder and opens the log. A fresh run removes what an earlier run left in the folder; a resumed run
 * keeps the lines of the log up to `step`. */
pags_result pags_output_open(pags_output *output, int resumed, int64_t step);
/* Closes the log and lets the folder go. If `failed` and the folder holds no checkpoint, the log is removed, and so is
 * the folder, if this run made it and it is empty. */
void pags_output_close(pags_output *output, int failed);

/* A line of the log. It contains no times, so that the logs of equal runs are equal. */
typedef struct pags_log_entry {
  int64_t step, gaussians;
  int level, sh_degree;                            /* level of downscaled photographs, 0: full size; SH degree in use */
  double loss, psnr;                               /* running means over about one pass through the training views */
  double step_loss, step_l1, step_ssim, step_psnr; /* of the step's view alone */
  pags_driving_losses terms;                       /* of the step's view alone, times their weights in the loss */
  int64_t bad_rows; /* Gaussians' updates left out for a number that isn't finite, in the whole run */
} pags_log_entry;
pags_result pags_output_log(pags_output *output, const pags_log_entry *entry);
typedef struct pags_density_change { /* sums over all models */
  int64_t cloned, split, pruned, wanted;
} pags_density_change;
/* A line for held-out views: the mean of their PSNR, and how many they are. */
pags_result pags_output_log_held_out(pags_output *output, int64_t step, int64_t gaussians, double psnr, int views);
pags_result pags_output_log_density(pags_output *output, int64_t step, const pags_density_change *change,
                                    int64_t gaussians);
pags_result pags_output_log_prune(pags_output *output, int64_t step, int64_t pruned, int64_t gaussians);

/* Writes preview_STEP.png: the rendered picture next to its photograph. */
pags_result pags_output_preview(const pags_output *output, int64_t step, const pags_picture *picture,
                                const pags_photo *photo);

/* Writes scene.json, its PLYs and the sky; no Adam steps may be pending. With the setting sh_error > 0, the background
 * gets one PLY for each SH degree that its Gaussians need, and an object's PLY has the highest degree that one of its
 * Gaussians needs. */
pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state);
/* Lists the data set's views in scene->views, which the caller frees, with the current exposures, and sets the
 * scene's span of time. */
pags_result pags_output_list_views(const pags_dataset *dataset, const pags_train_state *state, pags_scene *scene);
/* The current scene of a run, which borrows the run's Gaussians, and its clusters by model. */
typedef struct pags_described pags_described;
pags_result pags_output_describe(const pags_dataset *dataset, const pags_train_state *state, pags_described **out);
const pags_scene *pags_described_scene(const pags_described *described);
void pags_described_destroy(pags_described *described); /* NULL is allowed */
/* Computes the number of bytes that pags_output_scene would write now, for the limit on the scene's size; without the
 * PLYs and the data set's path in scene.json. */
pags_result pags_output_bytes(const pags_dataset *dataset, const pags_train_state *state, uint64_t *bytes);

/* Writes report.json; `command_line` may be NULL. */
pags_result pags_output_report(const pags_output *output, const pags_train_result *result, const char *command_line,
                               pags_tasks *tasks);

#endif
