/* SPDX-License-Identifier: Apache-2.0 */
/* The checkpoint of a training run: one file from which a resumed run computes the same bits as one that was never
 * interrupted.
 *
 * The file begins with "PAGSRUN4"; sections follow: tag (4 bytes), size of the payload (u64), payload, CRC-32 of tag,
 * size and payload (u32); all little endian. CONF is the configuration as text, RUN0 the numbers of run_record in
 * checkpoint.c. Then, for each model: MODL the numbers of model_record; then planes of count floats: GAUS the
 * parameters, MOM1 and MOM2 the moments (Fourier terms after the standard planes); STEP the two steps of each cluster
 * (pending Adam steps are stored as pending); STAT the densify statistics; and, each only if the model has them, OBJI
 * object numbers, SSEM priorities, SQUA squared derivatives. TRAK holds the increments and moments of all keyframes
 * (the labelled poses come from the data set), SKY0 texels, moments and visits, EXPO the exposures, CAMS (only if they
 * were tried) the corrections of camera poses, LITE (likewise) the cameras' light, TEST (likewise) the test of
 * exposures, BADR (only if there was one) the number of updates left out and the first of them, KERN (absent in old
 * files) the kernels that computed it, END! nothing. Sections come in this order. */
#ifndef PAGS_TRAIN_CHECKPOINT_H
#define PAGS_TRAIN_CHECKPOINT_H

#include <stdbool.h>

#include "train/state.h"

/* Writes the checkpoint to a temporary file next to `path`, then renames it. `fingerprint` identifies the data set's
 * views. Collective: each rank writes its rows to its own `path`, rank 0 the sky as well; or, with `whole`, rank 0
 * writes all rows, of which it has one column in memory at a time. Every rank learns of a failure. `transport` is NULL
 * for a process alone. */
pags_result pags_checkpoint_save(const char *path, pags_transport *transport, bool whole, const pags_train_state *state,
                                 uint64_t fingerprint);

/* Reads a checkpoint. `state` is overwritten; on failure there is nothing to free. Error messages name the file and
 * the section. `dataset` is the run's data set, whose labelled poses the increments are relative to; it may be NULL
 * if the run has no tracks, sky or exposures. `fingerprint` receives the one that was saved. */
pags_result pags_checkpoint_load(const char *path, const pags_dataset *dataset, pags_train_state *state,
                                 uint64_t *fingerprint);

typedef struct pags_checkpoint_facts {
  int64_t step, stop, views, models, gaussians;
  int sh_degree;
  double loss;
} pags_checkpoint_facts;

/* Checks the CRC of every section and reports what the file holds; needs no data set. */
pags_result pags_checkpoint_inspect(const char *path, pags_checkpoint_facts *out);

#endif
