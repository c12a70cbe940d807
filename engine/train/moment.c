/* SPDX-License-Identifier: Apache-2.0 */
/* A run between two steps, as progress callbacks see it: its scene to draw and its checkpoint. Applying pending Adam
 * steps early changes no bit of the run (adam.h). */
#include <assert.h>
#include <pags/compose.h>

#include "train/run.h"
#include "train/shards.h"

pags_result pags_train_moment_compose(pags_train_moment *moment, pags_composition **out) {
  pags_trainer *t = (pags_trainer *)moment;
  const int64_t models = t->state.model_count;
  assert(!t->described);
  *out = NULL;
  pags_state_flush(&t->state, t->tasks);
  PAGS_AUTOFREE const pags_clusters **clusters = malloc((size_t)(models > 0 ? models : 1) * sizeof *clusters);
  pags_result result = clusters ? PAGS_OK : pags_out_of_memory("%lld models", (long long)models);
  for (int64_t i = 0; clusters && i < models; i++)
    clusters[i] = &t->state.models[i].clusters;
  if (result == PAGS_OK)
    result = pags_output_describe(t->dataset, &t->state, &t->described);
  if (result == PAGS_OK)
    result = pags_composition_borrow(pags_described_scene(t->described), clusters, out);
  if (result != PAGS_OK)
    pags_train_moment_release(moment, NULL);
  return result;
}

void pags_train_moment_release(pags_train_moment *moment, pags_composition *composition) {
  pags_trainer *t = (pags_trainer *)moment;
  pags_composition_destroy(composition);
  pags_described_destroy(t->described);
  t->described = NULL;
}

pags_result pags_train_moment_save(pags_train_moment *moment) {
  pags_trainer *t = (pags_trainer *)moment;
  pags_state_flush(&t->state, t->tasks); /* so that the file's bytes don't tell when somebody has drawn the scene */
  return pags_shards_save(t->output.checkpoint, t->ranks > 1 ? t->options->transport : NULL, &t->state, t->fingerprint);
}
