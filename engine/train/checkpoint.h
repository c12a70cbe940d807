/* SPDX-License-Identifier: Apache-2.0 */
/* A run on disk: one file from which it goes on to the same bits.
 *
 * "PAGSRUN4", then sections: tag (4 bytes), size of the payload (u64), payload, CRC-32 of tag, size and payload
 * (u32); all little endian. CONF is the configuration as text, RUN0 the numbers of run_record in checkpoint.c. Then for
 * each model: MODL the numbers of model_record, planes of count floats: GAUS the parameters, MOM1 and MOM2 the moments
 * (Fourier terms behind the others); STEP the two steps of each cluster (what rows owe is stored as owed), STAT the
 * densify statistics, OBJI object numbers, SSEM priorities, SQUA squared derivatives, each where there are any. TRAK
 * holds increments and moments of all knots (labels come from the data set), SKY0 texels, moments and visits, EXPO the
 * exposures, BADR (only where there was one) how many updates were left out and the first of them, END! nothing.
 * Sections come in this order. */
#ifndef PAGS_TRAIN_CHECKPOINT_H
#define PAGS_TRAIN_CHECKPOINT_H

#include "train/state.h"

/* Written beside and renamed. `fingerprint` identifies the data set's views. */
pags_result pags_checkpoint_save(const char *path, const pags_train_state *state, uint64_t fingerprint);

/* `state` is overwritten; nothing to free on failure. Messages name the file and the section. `dataset`: of the run;
 * its labels are what increments belong to. NULL where the run has no tracks, sky and exposures. */
pags_result pags_checkpoint_load(const char *path, const pags_dataset *dataset, pags_train_state *state,
                                 uint64_t *fingerprint);

typedef struct pags_checkpoint_facts {
  int64_t step, stop, views, models, gaussians;
  int sh_degree;
  double loss;
} pags_checkpoint_facts;

/* Checks the CRC of every section and says what the file holds; needs no data set. */
pags_result pags_checkpoint_inspect(const char *path, pags_checkpoint_facts *out);

#endif
