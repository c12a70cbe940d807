/* SPDX-License-Identifier: Apache-2.0 */
/* Resources that a training took on each rank, for the report. */
#ifndef PAGS_CLI_RANKS_TRAIN_H
#define PAGS_CLI_RANKS_TRAIN_H

#include <pags/train.h>

#include "base/json.h"

typedef struct pags_rank_share {
  int64_t bytes_sent; /* to other ranks */
  uint64_t peak_rss_bytes;
  double ms_processor; /* as in pags_train_result */
  pags_train_traffic traffic;
} pags_rank_share;

typedef struct pags_rank_shares {
  int count;             /* 0: one process, or not rank 0 */
  pags_rank_share *each; /* freed by the caller */
} pags_rank_shares;

/* Collective: gathers the results of all ranks on rank 0. */
pags_result pags_rank_shares_gather(const pags_train_result *own, pags_rank_shares *out);

/* "on 4 ranks of 1 thread, which sent each other 1.2 GB, 0.7 MB a photograph; at most 61 MB a rank\n" */
void pags_rank_shares_describe(const pags_rank_shares *shares, int threads, char *text, size_t size);
/* Members of the report's object; nothing for one process. */
void pags_rank_shares_put(const pags_rank_shares *shares, pags_json_writer *writer);

#endif
