/* SPDX-License-Identifier: Apache-2.0 */
/* Writes synthetic streets into the scratch folder. */
#ifndef PAGS_TESTS_WRITTEN_STREET_H
#define PAGS_TESTS_WRITTEN_STREET_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <pags/synth.h>
#include <pags/tasks.h>

#include "scratch_folder.h"

static inline void write_street(const char *set, const pags_street_options *options, int threads) {
  pags_tasks *tasks = pags_tasks_create(threads);
  if (pags_synth_street(scratch(set), options, tasks, NULL, NULL) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  pags_tasks_destroy(tasks);
}

#endif
