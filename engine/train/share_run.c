/* SPDX-License-Identifier: Apache-2.0 */
/* Shares a run out to ranks; see stages.h. */
#include "train/stages.h"

#include "cluster/shares.h"

pags_result pags_share_run_begin(pags_trainer *t) {
  const int64_t models = t->state.model_count;
  t->round = calloc((size_t)t->ranks, sizeof *t->round);
  PAGS_CHECK_MEMORY(t->round, "the views of %d ranks", t->ranks);
  if (t->ranks == 1)
    return PAGS_OK;
  PAGS_TRY(pags_shared_views_create(&t->shared, t->options->transport, t->tasks));
  pags_sharing *const s = &t->sharing;
  *s = (pags_sharing){.transport = t->options->transport, .models = models};
  s->rows = malloc((size_t)models * (size_t)(t->ranks + 2) * sizeof *s->rows);
  PAGS_CHECK_MEMORY(s->rows, "the shares of %lld models", (long long)models);
  s->begin = s->rows + models;
  for (int64_t i = 0; i < models; i++)
    s->rows[i] = t->state.models[i].gaussians.count;
  PAGS_TRY(pags_share_sum(s->transport, s->rows, (int)models));
  pags_shares_cut(s->rows, models, t->state.schedule.config.picture.cluster_size, t->ranks, s->begin);
  for (int64_t i = 0; i < models; i++) {
    pags_train_model *const m = &t->state.models[i];
    m->sharing = s;
    m->index = i;
    m->first_row = s->begin[i * (t->ranks + 1) + t->shared.rank];
    m->total = s->rows[i];
  }
  return pags_transport_agree(s->transport, pags_sky_fit_share(&t->state.sky, t->shared.rank, t->ranks));
}

pags_result pags_share_run_end(pags_trainer *t) {
  if (t->ranks == 1)
    return PAGS_OK;
  pags_shared_views_destroy(&t->shared); /* makes room for the scene */
  pags_view_render_destroy(t);
  for (int64_t m = 0; m < t->state.model_count; m++) {
    PAGS_TRY(pags_model_collect(&t->state.models[m]));
    t->state.models[m].sharing = NULL;
  }
  t->ranks = 1;
  return PAGS_OK;
}

void pags_share_run_destroy(pags_trainer *t) {
  pags_shared_views_destroy(&t->shared);
  pags_sky_parts_destroy(&t->sky_parts);
  free(t->sharing.rows);
  free(t->round);
}

pags_result pags_share_run_agree(const pags_trainer *t, pags_result mine, bool *stop, bool *save) {
  if (t->ranks == 1)
    return mine;
  int64_t sums[] = {*stop, t->shared.rank == 0 && *save, mine != PAGS_OK};
  PAGS_TRY(pags_share_sum(t->shared.transport, sums, 3));
  *stop = sums[0] > 0;
  *save = sums[1] > 0;
  return sums[2] > 0 ? pags_transport_agree(t->shared.transport, mine) : PAGS_OK;
}
