/* SPDX-License-Identifier: Apache-2.0 */
/* Trains with two ranks, which are threads here, and refuses one allocation. Both ranks must end, with the same error
 * or with the same scene. A checkpoint in the folder can be resumed. No rank waits for a failed one. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pags/train.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "cluster/thread_ranks.h"
#include "memory_guard.h"
#include "small_street.h"

enum { RANKS = 2, BATCH = 2, PHOTOGRAPHS = 40, SAMPLES = 16, RESUMED = 3, PATIENCE = 60 };

typedef struct failing_run {
  pags_train_config config;
  char folder[1024];
  pags_tasks *tasks[RANKS];
  pags_result results[RANKS];
  char messages[RANKS][1024];
} failing_run;

static failing_run run;

static pags_train_options options_of(pags_tasks *workers) {
  pags_train_options options = pags_train_options_default();
  options.dataset = dataset;
  options.output = run.folder;
  options.tasks = workers;
  options.preview_every = 0;
  options.log_every = 1;
  options.checkpoint_every = 5;
  return options;
}

static const char *run_one_rank(pags_transport *transport, void *unused) {
  (void)unused;
  const int rank = pags_transport_rank(transport);
  pags_train_options options = options_of(run.tasks[rank]);
  pags_train_result result;
  options.transport = transport;
  options.overwrite = 1;
  run.results[rank] = pags_train(&run.config, &options, &result);
  snprintf(run.messages[rank], sizeof run.messages[rank], "%s", pags_error_message());
  return "";
}

/* Trains with one allocation refused. Returns the number of allocations. */
static int64_t train(int64_t refused) {
  for (int rank = 0; rank < RANKS; rank++)
    run.results[rank] = PAGS_ERROR_MEMORY; /* stays if even the ranks can't be made */
  memory_guard_begin(0, refused);
  run_ranks(RANKS, 0, PATIENCE, run_one_rank, NULL);
  memory_guard_end();
  return memory_guard_count();
}

static uint64_t hash_of(const char *file) {
  uint64_t hash = 14695981039346656037u;
  char path[1100];
  uint8_t *bytes;
  size_t size;
  snprintf(path, sizeof path, "%s/%s", run.folder, file);
  if (pags_file_read(path, &bytes, &size) != PAGS_OK)
    return 0;
  for (size_t i = 0; i < size; i++)
    hash = (hash ^ bytes[i]) * 1099511628211u;
  free(bytes);
  return hash;
}

static uint64_t hash_of_scene(void) {
  return hash_of("background.ply") ^ 3 * hash_of("scene.json") ^ 5 * hash_of("log.jsonl");
}

static void try_once(int64_t refused, uint64_t expected) {
  train(refused);
  if (memory_guard_live() != 0)
    fail_msg("allocation %lld refused: %lld blocks are left", (long long)refused, (long long)memory_guard_live());
  for (int rank = 0; rank < RANKS; rank++) {
    if (run.results[rank] != run.results[0])
      fail_msg("allocation %lld refused: rank 0: %s (%s); rank %d: %s (%s)", (long long)refused,
               pags_result_name(run.results[0]), run.messages[0], rank, pags_result_name(run.results[rank]),
               run.messages[rank]);
    if (run.results[rank] != PAGS_OK && (run.results[rank] != PAGS_ERROR_MEMORY ||
                                         strstr(run.messages[rank], "silent") || strstr(run.messages[rank], "ended")))
      fail_msg("allocation %lld refused: %s", (long long)refused, run.messages[rank]);
  }
  if (run.results[0] == PAGS_OK)
    assert_true(hash_of_scene() == expected);
}

/* One process resumes the checkpoint of a failed run and reaches the bits of a run without failure. */
static bool goes_on(uint64_t expected) {
  char path[1100];
  snprintf(path, sizeof path, "%s/checkpoint.pags", run.folder);
  if (!pags_path_exists(path))
    return false;
  pags_train_options options = options_of(tasks);
  pags_train_result result;
  options.resume = 1;
  if (pags_train(&run.config, &options, &result) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_int_equal(result.resumed, 1);
  assert_true(hash_of_scene() == expected);
  return true;
}

static void allocations(void **unused) {
  (void)unused;
  snprintf(run.folder, sizeof run.folder, "%s", scratch("run"));
  run.config = pags_train_config_default();
  run.config.schedule.iterations = PHOTOGRAPHS;
  run.config.schedule.resolution_floor = 24;
  run.config.schedule.batch = BATCH;
  run.config.objects.fourier_gain = 0;
  for (int rank = 0; rank < RANKS; rank++)
    assert_non_null(run.tasks[rank] = pags_tasks_create(1));
  train(0); /* twice: some allocations of the first run last as long as the process */
  const int64_t count = train(0);
  const uint64_t expected = hash_of_scene();
  assert_int_equal(run.results[0], PAGS_OK);
  int failed = 0, resumed = 0;
  for (int i = 0; i < SAMPLES; i++) {
    try_once(1 + i * (count - 1) / SAMPLES, expected);
    failed += run.results[0] != PAGS_OK;
    if (run.results[0] != PAGS_OK && resumed < RESUMED && i % (SAMPLES / 8) == 0)
      resumed += goes_on(expected);
  }
  print_message("%lld allocations, %d refused one by one: %d errors, %d of these gone on with\n", (long long)count,
                SAMPLES, failed, resumed);
  assert_true(failed > SAMPLES / 2 && resumed > 1);
  for (int rank = 0; rank < RANKS; rank++)
    pags_tasks_destroy(run.tasks[rank]);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(allocations)};
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
