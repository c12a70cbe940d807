/* SPDX-License-Identifier: Apache-2.0 */
/* Fits the exposures of training photographs (gain and offset per channel) by Adam; see exposure.h. */
#include "train/exposure.h"

#include <math.h>

#include "base/memory.h"
#include "maths/maths.h"

/* The learning rate at the schedule's end as a share of that at its beginning; log-linear between. */
static const double final_share = 0.1;

static int64_t camera_of(const pags_dataset *dataset, int64_t view) {
  int sensor = pags_dataset_view(dataset, view)->sensor;
  return sensor < 0 ? 0 : 1 + (int64_t)sensor;
}

pags_result pags_exposures_create(pags_exposures *exposures, const pags_dataset *dataset) {
  *exposures =
      (pags_exposures){.count = pags_dataset_view_count(dataset), .sensors = 1, .mean = {1.0, 1.0, 1.0, 0.0, 0.0, 0.0}};
  for (int64_t i = 0; i < exposures->count; i++) {
    const int64_t camera = camera_of(dataset, i);
    exposures->sensors = camera < exposures->sensors ? exposures->sensors : camera + 1;
  }
  exposures->items = calloc((size_t)(exposures->count + exposures->sensors), sizeof *exposures->items);
  PAGS_CHECK_MEMORY(exposures->items, "exposures of %lld views", (long long)exposures->count);
  for (int64_t i = 0; i < exposures->count; i++)
    memcpy(exposures->items[i].value, exposures->mean, sizeof exposures->mean);
  return PAGS_OK;
}

void pags_exposures_destroy(pags_exposures *exposures) {
  free(exposures->items);
  *exposures = (pags_exposures){.holdout = exposures->holdout};
}

void pags_exposures_value(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view, double value[6]) {
  const pags_exposure *camera = exposures->items + exposures->count + camera_of(dataset, view);
  for (int k = 0; k < 6; k++)
    value[k] = exposures->items[view].value[k] + camera->value[k];
}

/* Returns the nearest training view before (`step` -1) or after (1) a view; the view itself if no such view exists. */
static int64_t nearest_trained(const pags_dataset *dataset, int64_t view, int step) {
  const int64_t count = pags_dataset_view_count(dataset);
  int64_t i = view + step;
  while (i >= 0 && i < count && pags_dataset_view(dataset, i)->test)
    i += step;
  return i >= 0 && i < count ? i : view;
}

void pags_exposures_between(const pags_exposures *exposures, const pags_dataset *dataset, int64_t view,
                            double value[6]) {
  int64_t before = nearest_trained(dataset, view, -1), after = nearest_trained(dataset, view, 1);
  before = before == view ? after : before;
  after = after == view ? before : after;
  double a[6], b[6];
  pags_exposures_value(exposures, dataset, before, a);
  pags_exposures_value(exposures, dataset, after, b);
  const double t = after > before ? (double)(view - before) / (double)(after - before) : 0.0;
  for (int k = 0; k < 6; k++)
    value[k] = (1 - t) * a[k] + t * b[k];
}

bool pags_exposures_follow_names(const pags_exposures *exposures, const pags_dataset *dataset) {
  double from_middle = 0, from_mean = 0; /* sums of squares; the mean is gain 1 and offset 0 */
  for (int64_t i = 0; i < exposures->count; i++) {
    double own[6], middle[6];
    if (pags_dataset_view(dataset, i)->test || nearest_trained(dataset, i, -1) == i ||
        nearest_trained(dataset, i, 1) == i)
      continue;
    pags_exposures_value(exposures, dataset, i, own);
    pags_exposures_between(exposures, dataset, i, middle);
    for (int k = 0; k < 6; k++) {
      const double mean = k < 3 ? 1.0 : 0.0;
      from_middle += (own[k] - middle[k]) * (own[k] - middle[k]);
      from_mean += (own[k] - mean) * (own[k] - mean);
    }
  }
  return from_middle < from_mean;
}

bool pags_exposures_update(pags_exposures *exposures, const pags_dataset *dataset, int64_t view,
                           const double gradient[6], const pags_schedule *schedule, int64_t step) {
  const pags_train_config *c = &schedule->config;
  const double t = fmin((double)step / (double)schedule->length, 1.0),
               rate = c->exposure.exposure_rate * pags_pow(final_share, t);
  pags_exposure *const parts[2] = {&exposures->items[view],
                                   &exposures->items[exposures->count + camera_of(dataset, view)]};
  bool moved = true;
  for (int part = 0; part < 2 && moved; part++) {
    double direction[6];
    moved = pags_adam6_step(&parts[part]->moments, gradient, c, direction);
    for (int k = 0; k < 6 && moved; k++)
      parts[part]->value[k] -= rate * direction[k];
  }

  /* Subtract the deviation of the mean exposure over the training views from every camera's part. */
  double mean[6] = {0.0}, value[6];
  int64_t training = 0;
  for (int64_t i = 0; i < exposures->count; i++) {
    if (pags_dataset_view(dataset, i)->test)
      continue;
    training++;
    pags_exposures_value(exposures, dataset, i, value);
    for (int k = 0; k < 6; k++)
      mean[k] += value[k];
  }
  for (int64_t i = exposures->count; i < exposures->count + exposures->sensors; i++)
    for (int k = 0; k < 6; k++)
      exposures->items[i].value[k] -= mean[k] / (double)(training > 0 ? training : 1) - exposures->mean[k];
  return moved;
}
