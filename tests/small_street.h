/* SPDX-License-Identifier: Apache-2.0 */
/* A small street with moving cars, made in the scratch folder, for one test program. */
#ifndef PAGS_TESTS_SMALL_STREET_H
#define PAGS_TESTS_SMALL_STREET_H

#include <pags/dataset.h>
#include <pags/synth.h>
#include <pags/tasks.h>

#include "scratch_folder.h"

enum { FRAMES = 12 };

static pags_tasks *tasks;
static pags_dataset *dataset;
static int small_street_cameras = 1;
static const char *const *small_street_faults = NULL; /* ends with NULL */

/* Set-up and tear-down for a group of cmocka tests. */
static inline int make_street(void **unused) {
  (void)unused;
  pags_street_options options = pags_street_options_default();
  pags_dataset_options reading = pags_dataset_options_default();
  options.width = 96;
  options.height = 64;
  options.frames = FRAMES;
  options.cameras = small_street_cameras;
  options.samples = 2;
  options.objects = 3;
  options.lidar_points = 4000;
  options.shifts = 0;
  for (const char *const *fault = small_street_faults; fault && *fault; fault++)
    if (pags_street_faults_set(&options.faults, *fault) != PAGS_OK)
      return -1;
  tasks = pags_tasks_create(2);
  if (!tasks || scratch_make() != 0 || pags_synth_street(scratch("street"), &options, tasks, NULL, NULL) != PAGS_OK)
    return -1;
  return pags_dataset_open(scratch("street"), &reading, &dataset) == PAGS_OK ? 0 : -1;
}

static inline int remove_street(void **unused) {
  (void)unused;
  pags_dataset_close(dataset);
  pags_tasks_destroy(tasks);
  return scratch_remove();
}

#endif
