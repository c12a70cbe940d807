/* A run on disk: one file from which it goes on to the same bits.
 *
 * "PAGSRUN1", then sections: tag (4 bytes), size of the payload (u64), payload, CRC-32 of tag, size and payload
 * (u32); all little endian. CONF is the configuration as text, RUN0 the numbers of run_record in checkpoint.c, then
 * planes of count floats: GAUS the parameters, MOM1 and MOM2 the moments; STEP the two steps of each cluster (what
 * rows owe is stored as owed), STAT the densify statistics, END! nothing. Sections come in this order, each once. */
#ifndef PAGS_TRAIN_CHECKPOINT_H
#define PAGS_TRAIN_CHECKPOINT_H

#include "train/state.h"

/* Written beside and renamed. `fingerprint` identifies the data set's views. */
pags_result pags_checkpoint_save(const char *path, const pags_train_state *state, uint64_t fingerprint);

/* `state` is overwritten; nothing to free on failure. Messages name the file and the section. */
pags_result pags_checkpoint_load(const char *path, pags_train_state *state, uint64_t *fingerprint);

#endif
