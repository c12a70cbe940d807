/* SPDX-License-Identifier: Apache-2.0 */
/* Checkpoints of a run whose rows are spread over the ranks of a job (cluster/transport.h). Every rank's state has all
 * models, with the rows that it owns: contiguous ones in the order of ranks, cut at clusters. Everything except rows
 * (tracks, sky, exposures, numbers) is taken from rank 0's.
 *
 * Each rank writes its state as an ordinary checkpoint (train/checkpoint.h), a shard, next to PATH: PATH.gG.R, G the
 * generation, R the rank. Once all are on disk, rank 0 replaces PATH by a manifest, JSON that names the shards; then
 * the shards of earlier generations are removed. So PATH names the whole old checkpoint or the whole new one at
 * any moment. A run of one rank has its checkpoint at PATH itself.
 *
 * Any number of ranks reads what any number has written. */
#ifndef PAGS_TRAIN_SHARDS_H
#define PAGS_TRAIN_SHARDS_H

#include "cluster/transport.h"
#include "train/checkpoint.h"

/* Collective. On failure, which all ranks learn of, PATH is what it was. */
pags_result pags_shards_save(const char *path, pags_transport *transport, const pags_train_state *state,
                             uint64_t fingerprint);

/* Collective. The same, but one file at PATH, as one rank writes it. */
pags_result pags_shards_save_whole(const char *path, pags_transport *transport, const pags_train_state *state,
                                   uint64_t fingerprint);

/* Shares out the rows of `models` models of rows[] rows each: model m's rows [begin[m * (ranks + 1) + r], begin[m *
 * (ranks + 1) + r + 1]) are rank r's; cuts within a model lie at multiples of `cluster` rows. */
typedef void pags_shards_cut_fn(const int64_t *rows, int64_t models, int cluster, int ranks, int64_t *begin);

/* Collective. Reads a checkpoint of one rank or of several; each rank's state gets the rows that `cut` gives it. A rank
 * reads those shards alone that hold rows of its own, and has these in memory together with its state. Otherwise as
 * pags_checkpoint_load. */
pags_result pags_shards_load(const char *path, pags_transport *transport, pags_shards_cut_fn *cut,
                             const pags_dataset *dataset, pags_train_state *state, uint64_t *fingerprint);

#endif
