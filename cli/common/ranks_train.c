/* SPDX-License-Identifier: Apache-2.0 */
/* Implements ranks_train.h. */
#include "cli/common/ranks_train.h"

#include <stdio.h>
#include <string.h>

#include "cli/common/progress.h"
#include "cli/common/ranks.h"

pags_result pags_rank_shares_gather(const pags_train_result *own, pags_rank_shares *out) {
  pags_rank_share mine;
  *out = (pags_rank_shares){0};
  if (!pags_ranks())
    return PAGS_OK;
  memset(&mine, 0, sizeof mine);
  mine.bytes_sent = pags_transport_counted(pags_ranks()).bytes_sent;
  mine.peak_rss_bytes = own->peak_rss_bytes;
  mine.ms_processor = own->ms_processor;
  mine.traffic = own->traffic;
  void *all;
  int64_t bytes;
  PAGS_TRY(pags_ranks_gather(&mine, sizeof mine, &all, &bytes));
  out->each = all;
  out->count = (int)(bytes / (int64_t)sizeof mine);
  return PAGS_OK;
}

/* Sums of all ranks; of the peaks the largest. */
static pags_rank_share add_up(const pags_rank_shares *shares) {
  pags_rank_share sum = {0};
  for (int r = 0; r < shares->count; r++) {
    const pags_rank_share *const one = shares->each + r;
    sum.bytes_sent += one->bytes_sent;
    sum.peak_rss_bytes = one->peak_rss_bytes > sum.peak_rss_bytes ? one->peak_rss_bytes : sum.peak_rss_bytes;
    sum.ms_processor += one->ms_processor;
    sum.traffic.views += one->traffic.views;
    sum.traffic.splats += one->traffic.splats;
    sum.traffic.bytes_there += one->traffic.bytes_there;
    sum.traffic.bytes_back += one->traffic.bytes_back;
  }
  return sum;
}

void pags_rank_shares_describe(const pags_rank_shares *shares, int threads, char *text, size_t size) {
  char sent[32], view[32], peak[32];
  const pags_rank_share all = add_up(shares);
  const double views = all.traffic.views > 0 ? (double)all.traffic.views : 1.0;
  snprintf(text, size, "on %d ranks of %d %s, which sent each other %s, %s per photograph; at most %s per rank\n",
           shares->count, threads, threads == 1 ? "thread" : "threads",
           pags_format_bytes((double)all.bytes_sent, sent, sizeof sent),
           pags_format_bytes((double)(all.traffic.bytes_there + all.traffic.bytes_back) / views, view, sizeof view),
           pags_format_bytes((double)all.peak_rss_bytes, peak, sizeof peak));
}

void pags_rank_shares_put(const pags_rank_shares *shares, pags_json_writer *writer) {
  if (shares->count == 0)
    return;
  pags_json_put_integer(writer, "ranks", shares->count);
  pags_json_put_integer(writer, "bytes_sent", add_up(shares).bytes_sent);
  pags_json_begin_array(writer, "each_rank");
  for (int r = 0; r < shares->count; r++) {
    const pags_rank_share *const one = shares->each + r;
    pags_json_begin_object(writer, NULL);
    pags_json_put_unsigned(writer, "peak_rss_bytes", one->peak_rss_bytes);
    pags_json_put_number(writer, "processor_ms", one->ms_processor);
    pags_json_put_integer(writer, "photographs", one->traffic.views);
    pags_json_put_integer(writer, "splats", one->traffic.splats);
    pags_json_put_integer(writer, "bytes_there", one->traffic.bytes_there);
    pags_json_put_integer(writer, "bytes_back", one->traffic.bytes_back);
    pags_json_put_integer(writer, "bytes_sent", one->bytes_sent);
    pags_json_end_object(writer);
  }
  pags_json_end_array(writer);
}
