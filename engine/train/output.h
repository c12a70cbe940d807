/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the output folder of a training run: log.jsonl, previews, the scene, report.json. The checkpoint, in the
 * same folder, is written by checkpoint.c. */
#ifndef PAGS_TRAIN_OUTPUT_H
#define PAGS_TRAIN_OUTPUT_H

#include <math.h>

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/scene.h>
#include <pags/train.h>

#include "base/file.h"
#include "base/memory.h"
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
 * or if it isn't empty and neither resume nor overwrite is set. *found: there is a checkpoint to resume. */
pags_result pags_output_find(pags_output *output, const pags_train_options *options, bool *found);
/* Creates the folder and opens the log. A fresh run removes what an earlier run left in the folder; a resumed run
 * keeps the lines of the log up to `step`. */
pags_result pags_output_open(pags_output *output, bool resumed, int64_t step);
/* Closes the log and lets the folder go. If `failed` and the folder holds no checkpoint, the log is removed, and so is
 * the folder, if this run made it and it is empty. */
void pags_output_close(pags_output *output, bool failed);

/* A number in a line of the log. Lines contain no times, so that the logs of equal runs are equal. */
typedef struct pags_log_value {
  const char *name;
  double value;
} pags_log_value;
/* Leaves a value out of a line. */
#define PAGS_LOG_NOTHING (-HUGE_VAL)
/* Writes a line and hands it to the operating system at once, so that the log of a killed run is almost complete. */
pags_result pags_output_log(pags_output *output, const pags_log_value *values, int count);

/* Writes preview_STEP.png: the rendered picture next to its photograph. */
pags_result pags_output_preview(const pags_output *output, int64_t step, const pags_picture *picture,
                                const pags_photo *photo);

/* Writes scene.json, its PLYs and the sky; no Adam steps may be pending. Once the SH degrees are chosen, the background
 * gets one PLY for each degree that its Gaussians need, and an object's PLY has the highest degree that one of its
 * Gaussians needs. */
pags_result pags_output_scene(const pags_output *output, const pags_dataset *dataset, const pags_train_state *state);
/* Lists the data set's views in scene->views, which the caller frees, with the current exposures, and sets the
 * scene's span of time. */
pags_result pags_output_list_views(const pags_dataset *dataset, const pags_train_state *state, pags_scene *scene);
/* The current scene of a run, which borrows the run's Gaussians, and its clusters by model. */
typedef struct pags_described pags_described;
/* *out must be destroyed on failure, too. */
pags_result pags_output_describe(const pags_dataset *dataset, const pags_train_state *state, pags_described **out);
const pags_scene *pags_described_scene(const pags_described *described);
void pags_described_destroy(pags_described *described); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_described, pags_described_destroy)
/* Computes the number of bytes that pags_output_scene would write now, for the limit on the scene's size; without the
 * sky, the PLYs and the data set's path in scene.json. */
pags_result pags_output_bytes(const pags_dataset *dataset, const pags_train_state *state, uint64_t *bytes);

/* Writes report.json; `command_line` may be NULL. */
pags_result pags_output_report(const pags_output *output, const pags_train_result *result, const char *command_line,
                               pags_tasks *tasks);

#endif
