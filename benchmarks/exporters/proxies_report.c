/* SPDX-License-Identifier: Apache-2.0 */
/* Functions shared by the measurements of pags-bench proxies: setting the street's time, and writing distances. */
#include "benchmarks/exporters/proxies.h"

pags_result pags_proxy_bench_time(pags_proxy_bench *self, double time) {
  if (time == self->stage_time)
    return PAGS_OK;
  self->stage_time = time;
  pags_street_set_time(&self->street, time);
  int first = self->street.first_moving, count = self->street.placement_count - first;
  return count > 0 ? pags_stage_commit(self->stage, first, count) : PAGS_OK;
}

double pags_bench_middle(const pags_proxy_bench *self) {
  const int64_t middle = self->options.frames / 2;
  for (int64_t i = 0; i < self->scene.view_count; i++)
    if (self->scene.views[i].frame == middle)
      return self->scene.views[i].camera.time;
  return (double)middle / self->options.fps;
}

void pags_proxy_bench_put(pags_json_writer *w, const char *key, const pags_proxy_distance *d) {
  const double values[3] = {d->mean, d->p95, d->max};
  pags_json_put_numbers(w, key, values, 3);
}
