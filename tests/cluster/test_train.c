/* SPDX-License-Identifier: Apache-2.0 */
/* Training shared among ranks, which are threads here. The folder has the bits of one process with the same batch. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include <pags/scene.h>
#include <pags/train.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "cluster/thread_ranks.h"
#include "small_street.h"
#include "train/schedule.h"

enum { BATCH = 4, PHOTOGRAPHS = 240, MOST_RANKS = 4 };

/* A short run that trains most features: the loss of moving objects, their colour over time, poses, exposure, sky and
 * dropout. */
static pags_train_config quick(void) {
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = PHOTOGRAPHS;
  config.schedule.resolution_floor = 24;
  config.schedule.batch = BATCH;
  config.priority.dropout = 1;
  config.objects.fourier_gain = 0;
  return config;
}

typedef struct shared_run {
  const pags_train_config *config;
  const char *folder;
  int threads; /* of each rank */
  int resume;
  double seconds; /* time limit in seconds; 0: none */
  pags_train_result results[MOST_RANKS];
} shared_run;

static pags_result run_one(const shared_run *run, pags_transport *transport, pags_train_result *result) {
  pags_train_options options = pags_train_options_default();
  options.dataset = dataset;
  options.output = run->folder;
  options.tasks = pags_tasks_create(run->threads);
  options.preview_every = 25;
  options.held_out = 1;
  options.time_limit_seconds = run->seconds;
  options.log_every = 1;
  options.resume = run->resume;
  options.transport = transport;
  const pags_result code = options.tasks ? pags_train(run->config, &options, result) : PAGS_ERROR_MEMORY;
  pags_tasks_destroy(options.tasks);
  return code;
}

static const char *run_rank_of_training(pags_transport *transport, void *user) {
  shared_run *const run = user;
  return run_one(run, transport, run->results + pags_transport_rank(transport)) == PAGS_OK ? "" : pags_error_message();
}

/* Compares the traffic of a view with docs/lab/cluster-model.md. Each splat is sent and its sums are returned, except
 * for the share of the drawing rank (on average 1 / ranks). The tolerance of 10 % covers the sums of pictures that show
 * only moving objects. */
static void check_traffic(const shared_run *run, int ranks) {
  pags_train_traffic all = {0};
  for (int r = 0; r < ranks; r++) {
    const pags_train_traffic *const one = &run->results[r].traffic;
    all.views += one->views;
    all.splats += one->splats;
    all.bytes_there += one->bytes_there;
    all.bytes_back += one->bytes_back;
  }
  assert_int_equal(all.views, PHOTOGRAPHS);
  const double away = (double)all.splats * (1.0 - 1.0 / ranks);
  if (fabs((double)all.bytes_there / (56.0 * away) - 1.0) > 0.1 ||
      fabs((double)all.bytes_back / (48.0 * away) - 1.0) > 0.1)
    fail_msg("%d ranks: %lld bytes there, %lld back; expected 56 and 48 of %g splats", ranks,
             (long long)all.bytes_there, (long long)all.bytes_back, away);
}

/* Trains in one process if `ranks` is 0; resumes from a checkpoint in the folder. */
static pags_train_result train(const pags_train_config *config, const char *name, int ranks, int threads) {
  static char folder[1024];
  shared_run *const run = calloc(1, sizeof *run);
  assert_non_null(run);
  snprintf(folder, sizeof folder, "%s", scratch(name));
  *run = (shared_run){.config = config, .folder = folder, .threads = threads, .resume = 1};
  if (ranks == 0 && run_one(run, NULL, run->results) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  if (ranks > 0)
    assert_true(run_ranks(ranks, 0, 60, run_rank_of_training, run));
  const pags_train_result result = run->results[0];
  if (ranks > 1 && !result.resumed && config->schedule.iterations == PHOTOGRAPHS)
    check_traffic(run, ranks);
  for (int r = 1; r < ranks; r++) {
    assert_int_equal(run->results[r].gaussians, result.gaussians);
    assert_true(run->results[r].loss == result.loss);
  }
  free(run);
  return result;
}

static void assert_same_file(const char *a, const char *b, const char *file) {
  char left[1024], right[1024];
  uint8_t *x, *y;
  size_t m, n;
  snprintf(left, sizeof left, "%s/%s", scratch(a), file);
  snprintf(right, sizeof right, "%s/%s", scratch(b), file);
  assert_int_equal(pags_file_read(left, &x, &m), PAGS_OK);
  assert_int_equal(pags_file_read(right, &y, &n), PAGS_OK);
  if (m != n || memcmp(x, y, m) != 0)
    fail_msg("%s differs from %s", left, right);
  free(x);
  free(y);
}

static void assert_same_run(const char *a, const char *b) {
  assert_same_file(a, b, "log.jsonl");
  assert_same_file(a, b, "scene.json");
  assert_same_file(a, b, "background.ply");
  assert_same_file(a, b, "sky.npz");
  assert_same_file(a, b, "checkpoint.pags");
  assert_same_file(a, b, "preview_0000025.png");
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch(a), &scene), PAGS_OK);
  assert_true(scene.model_count > 1);
  for (int64_t i = 1; i < scene.model_count; i++) {
    assert_same_file(a, b, scene.models[i].file);
    assert_true(scene.models[i].gaussians.fourier || strncmp(scene.models[i].name, "background", 10) == 0);
  }
  pags_scene_destroy(&scene);
}

/* Counts a word in a file of the run. */
static int count_in(const char *name, const char *file, const char *word) {
  char path[1024];
  uint8_t *bytes;
  size_t size;
  int found = 0;
  snprintf(path, sizeof path, "%s/%s", scratch(name), file);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  char *const text = calloc(size + 1, 1);
  assert_non_null(text);
  memcpy(text, bytes, size);
  for (const char *at = text; (at = strstr(at, word)) != NULL; at++)
    found++;
  free(text);
  free(bytes);
  return found;
}

static void ranks_change_no_bit(const pags_train_config *config, const char *name, int most_ranks) {
  char whole[64], shared[64];
  snprintf(whole, sizeof whole, "%s", name);
  const pags_train_result one = train(config, whole, 0, 2);
  assert_int_equal(one.bad_rows, 0);
  for (int ranks = 1; ranks <= most_ranks; ranks++) {
    snprintf(shared, sizeof shared, "%s%d", name, ranks);
    const pags_train_result got = train(config, shared, ranks, 1 + ranks % 2);
    assert_int_equal(got.gaussians, one.gaussians);
    assert_true(got.loss == one.loss);
    assert_same_run(whole, shared);
  }
}

static void without_density_control(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.density.densify_from = 100000;
  config.density.reset_every = 100000;
  config.priority.prunes = 0;
  ranks_change_no_bit(&config, "fixed", 3);
}

/* Tests growth up to a limit, pruning by score with floors of objects, opacity resets, and sorting after each of them.
 */
static void with_density_control(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.size_limit.max_gaussians = 4500;
  const int64_t views = pags_dataset_view_count(dataset);
  const pags_schedule schedule = pags_schedule_make(&config, 10.0, views);
  int densified = 0, reset = 0;
  for (int64_t step = 1; step <= PHOTOGRAPHS / BATCH; step++) {
    densified += pags_schedule_is_densify(&schedule, step);
    reset += pags_schedule_is_reset(&schedule, step);
  }
  assert_true(densified > 3);
  assert_true(reset > 0);
  ranks_change_no_bit(&config, "grown", 4);
  assert_true(count_in("grown4", "log.jsonl", "\"split\"") > 3);
  assert_true(count_in("grown4", "log.jsonl", "\"held_out_psnr\"") > 1);
  assert_true(count_in("grown4", "log.jsonl", "\"pruned_by_score\"") > 1);
}

/* A run ends while corrections of poses, vignettes and response curves are on trial. Other numbers of ranks resume the
 * run and end the trials. */
static void with_corrected_cameras(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.schedule.schedule_iterations = 4 * PHOTOGRAPHS;
  config.objects.fourier_from /= 4;
  ranks_change_no_bit(&config, "corrected", 3);
  assert_true(count_in("corrected", "scene.json", "\"correction\""));
  assert_true(count_in("corrected", "scene.json", "\"vignette\""));
  assert_false(count_in("corrected", "scene.json", "\"gain_db\""));
  config.schedule.iterations = 2 * PHOTOGRAPHS;
  train(&config, "corrected", 0, 1);
  train(&config, "corrected2", 3, 1);
  assert_same_run("corrected", "corrected2");
  assert_true(count_in("corrected", "scene.json", "\"gain_db\""));
}

/* Tests rare settings: a size that the scene must keep, the paper's scores and Fourier series, and the pull to LiDAR
 * planes. */
static void with_other_settings(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.schedule.iterations = PHOTOGRAPHS / 2;
  config.size_limit.target_size = 1.8;
  config.objects.fourier = PAGS_FOURIER_ALL;
  config.priority.score = PAGS_SCORE_PAPER;
  config.density.lidar_pull = config.density.lidar_lay = 0.1;
  ranks_change_no_bit(&config, "other", 2);
}

/* Tests Gaussians that are drawn at random over all ranks, move between ranks and are added. */
static void with_mcmc(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.schedule.iterations = PHOTOGRAPHS / 2;
  config.density.strategy = PAGS_STRATEGY_MCMC;
  ranks_change_no_bit(&config, "mcmc", 3);
}

/* The clock of rank 0 decides for all ranks. */
static void with_a_time_limit(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  shared_run run = {.config = &config, .folder = scratch("timed"), .threads = 1, .seconds = 2};
  assert_true(run_ranks(2, 0, 60, run_rank_of_training, &run));
  assert_int_equal(run.results[0].iterations, run.results[1].iterations);
  assert_true(run.results[0].loss == run.results[1].loss);
  assert_true(run.results[0].iterations != PHOTOGRAPHS);
}

/* Three ranks resume a run of two ranks in the middle of its growth, while Adam steps are pending. */
static void resumed_on_other_ranks(void **unused) {
  (void)unused;
  pags_train_config config = quick(), half = quick();
  config.objects.fourier = half.objects.fourier = PAGS_FOURIER_ALL;
  config.schedule.schedule_iterations = half.schedule.schedule_iterations = PHOTOGRAPHS;
  half.schedule.iterations = PHOTOGRAPHS / 2 + BATCH;
  train(&half, "one", 0, 1);
  train(&half, "several", 2, 1);
  assert_same_run("one", "several");
  assert_int_equal(train(&config, "one", 0, 1).resumed, 1);
  assert_int_equal(train(&config, "several", 3, 1).resumed, 1);
  assert_same_run("one", "several");
  train(&config, "unbroken", 0, 1);
  assert_same_file("one", "unbroken", "background.ply");
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch("unbroken"), &scene), PAGS_OK);
  for (int64_t i = 1; i < scene.model_count; i++) {
    assert_int_equal(scene.models[i].gaussians.fourier_degree, 1);
    assert_same_file("one", "unbroken", scene.models[i].file);
  }
  pags_scene_destroy(&scene);
}

static const char *run_rank_that_is_refused(pags_transport *transport, void *expected) {
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.dataset = dataset;
  options.output = scratch("refused");
  options.tasks = tasks;
  options.transport = transport;
  options.estimate = 1;
  const pags_train_config config = quick();
  const pags_result code = pags_train(&config, &options, &result);
  return code == PAGS_ERROR_UNSUPPORTED && strstr(pags_error_message(), expected) == pags_error_message()
             ? ""
             : "isn't refused";
}

/* An option that requires one process is refused before anything is written. The message names no rank. */
static void refuses(void **unused) {
  (void)unused;
  static char expected[] = "--estimate requires one process";
  assert_true(run_ranks(2, 0, 60, run_rank_that_is_refused, expected));
  assert_false(pags_path_exists(scratch("refused")));
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(without_density_control),
                                     cmocka_unit_test(with_density_control),
                                     cmocka_unit_test(with_other_settings),
                                     cmocka_unit_test(with_mcmc),
                                     cmocka_unit_test(with_a_time_limit),
                                     cmocka_unit_test(resumed_on_other_ranks),
                                     cmocka_unit_test(refuses)};
  const struct CMUnitTest of_cameras[] = {cmocka_unit_test(with_corrected_cameras)};
  static const char *const faults[] = {"position=0.2", "angle=1", "vignette=0.6", "response=0.2", NULL};
  const int failed = cmocka_run_group_tests(tests, make_street, remove_street);
  small_street_cameras = 3;
  small_street_faults = faults;
  return failed + cmocka_run_group_tests(of_cameras, make_street, remove_street);
}
