/* SPDX-License-Identifier: Apache-2.0 */
/* Shares a run out to ranks; see share_run.h. */
#include "train/share_run.h"

#include <stdlib.h>

#include "base/memory.h"
#include "cluster/shares.h"

static pags_result refuse(const char *what, const char *instead) {
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s can't be shared out to several ranks; %s, or train in one process", what,
                   instead);
}

pags_result pags_share_run_check(const pags_train_config *config, const pags_train_options *options) {
  if (pags_transport_ranks(options->transport) == 1)
    return PAGS_OK;
  if (options->time_limit_seconds > 0.0)
    return refuse("a run with a time limit", "give a number of iterations");
  if (options->estimate)
    return refuse("an estimate", "ask for it in one process");
  if (config->density.strategy == PAGS_STRATEGY_MCMC)
    return refuse("strategy mcmc", "take the default strategy");
  if (config->density.lidar_pull > 0.0)
    return refuse("lidar_pull", "set it to 0");
  if (config->objects.fourier && config->objects.objects)
    return refuse("colour over time", "set fourier to 0");
  if (config->size_limit.target_size > 0.0)
    return refuse("a target size", "give max_gaussians");
  if (config->priority.prunes > 0 && config->priority.s_grad_from == PAGS_S_GRAD_FROM_TRAINING)
    return refuse("s_grad_from training", "set it to pass");
  return PAGS_OK;
}

pags_result pags_share_run_begin(pags_trainer *t) {
  const int64_t models = t->state.model_count;
  t->round = calloc((size_t)t->ranks, sizeof *t->round);
  if (!t->round)
    return pags_out_of_memory("the views of %d ranks", t->ranks);
  if (t->ranks == 1)
    return PAGS_OK;
  PAGS_TRY(pags_shared_views_create(&t->shared, t->options->transport, t->tasks));
  pags_sharing *const s = &t->sharing;
  *s = (pags_sharing){.transport = t->options->transport, .models = models};
  s->rows = malloc((size_t)models * (size_t)(t->ranks + 2) * sizeof *s->rows);
  if (!s->rows)
    return pags_out_of_memory("the shares of %lld models", (long long)models);
  s->begin = s->rows + models;
  for (int64_t m = 0; m < models; m++)
    s->rows[m] = t->state.models[m].gaussians.count;
  pags_shares_cut(s->rows, models, t->state.schedule.config.picture.cluster_size, t->ranks, s->begin);
  pags_result mine = PAGS_OK;
  for (int64_t m = 0; mine == PAGS_OK && m < models; m++) {
    const int64_t *const cuts = s->begin + m * (t->ranks + 1) + t->shared.rank;
    mine = pags_model_keep_share(&t->state.models[m], cuts[0], cuts[1], t->tasks);
    t->state.models[m].sharing = s;
    t->state.models[m].index = m;
  }
  return pags_transport_agree(s->transport, mine);
}

pags_result pags_share_run_end(pags_trainer *t) {
  for (int64_t m = 0; t->ranks > 1 && m < t->state.model_count; m++) {
    PAGS_TRY(pags_model_collect(&t->state.models[m], t->shared.transport, t->tasks));
    t->state.models[m].sharing = NULL;
  }
  t->ranks = 1;
  pags_shared_views_destroy(&t->shared);
  return PAGS_OK;
}

void pags_share_run_destroy(pags_trainer *t) {
  pags_shared_views_destroy(&t->shared);
  pags_sky_parts_destroy(&t->sky_parts);
  free(t->sharing.rows);
  free(t->round);
}

pags_result pags_share_run_stops(const pags_trainer *t, int *stop) {
  int64_t stops = *stop;
  if (t->ranks > 1)
    PAGS_TRY(pags_share_sum(t->shared.transport, &stops, 1));
  *stop = stops > 0;
  return PAGS_OK;
}
