/* SPDX-License-Identifier: Apache-2.0 */
/* Looks at the photographs of an opened driving set (looks.h). */
#include "dataset/driving/looks.h"

#include "base/log.h"
#include "dataset/driving/driving_set.h"

/* A camera of a lower rate may have its photographs just at the time steps that are held out. */
static void check_held_out(const pags_dataset *dataset) {
  const pags_driving *driving = dataset->parsed.driving;
  pags_tally found = {0};
  for (int64_t i = 0; i < driving->sensor_count; i++) {
    const int number = driving->sensors[i].number;
    long long all = 0, held = 0;
    for (int64_t v = 0; v < dataset->count; v++) {
      all += dataset->views[v].sensor == number;
      held += dataset->views[v].sensor == number && dataset->views[v].test;
    }
    if (2 * held > all && number != driving->holdout)
      pags_tally_add(&found, "camera %d, %lld of whose %lld photographs are", number, held, all);
  }
  if (found.count)
    pags_log_message(
        PAGS_LOG_WARNING,
        "%s/images: more than half of the photographs of %lld of %lld cameras are held out, the first is %s; "
        "another --split-every holds out others, 0 none",
        driving->root, (long long)found.count, (long long)driving->sensor_count, found.first);
}

pags_result pags_driving_views_check(pags_dataset *dataset, const pags_dataset_options *options) {
  PAGS_TRY(pags_ego_masks_make(dataset, options));
  check_held_out(dataset);
  if (options->look)
    PAGS_TRY(pags_look_at_photographs(dataset));
  return options->look ? pags_look_for_mirror(dataset) : PAGS_OK;
}
