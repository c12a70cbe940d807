/* SPDX-License-Identifier: Apache-2.0 */
/* Checkpoints in shards: 1 to 5 ranks write them with random cuts, and 1 to 5 ranks read the same rows from them. A
 * failure on any rank leaves the old checkpoint. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/rng.h"
#include "cluster/thread_ranks.h"
#include "system.h"
#include "train/shards.h"
#include "unit/driving_tree.h"

enum { MODELS = 3, SIZE = 64, MOST_RANKS = 5 };
static const int64_t rows_of[MODELS] = {1000, 70, 0};

static pags_dataset *dataset; /* its objects are the second and third model */
static char folder[200], path[256];
static _Thread_local char wrong[512];

#define EXPECT(condition)                                                                            \
  do {                                                                                               \
    if (!(condition)) {                                                                              \
      snprintf(wrong, sizeof wrong, "line %d: %s (%s)", __LINE__, #condition, pags_error_message()); \
      return wrong;                                                                                  \
    }                                                                                                \
  } while (0)

/* `cut` divides the rows of each model among the ranks at random places, which depend on `cut_seed`. Some ranks have no
 * rows. */
static uint64_t cut_seed;

static int compare_counts(const void *a, const void *b) {
  const int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
  return (x > y) - (x < y);
}

static void cut(const int64_t *rows, int64_t models, int cluster, int ranks, int64_t *begin) {
  for (int64_t m = 0; m < models; m++) {
    int64_t *at = begin + m * (ranks + 1);
    const int64_t clusters = (rows[m] + cluster - 1) / cluster;
    for (int r = 1; r < ranks; r++) {
      const double u = pags_rng_uniform(cut_seed, (uint64_t)m, (uint64_t)r);
      const int64_t whole = cluster * (int64_t)(u * (double)(clusters + 1));
      at[r] = whole < rows[m] ? whole : rows[m];
      if (at[r] % cluster != 0)
        at[r] -= at[r] % cluster;
    }
    at[0] = 0;
    at[ranks] = rows[m];
    qsort(at + 1, (size_t)ranks - 1, sizeof *at, compare_counts);
  }
}

static float value(int64_t model, int plane, int64_t row) {
  return (float)pags_rng_uniform(5, (uint64_t)(model * 1000 + plane), (uint64_t)row);
}

/* go_through calls this for every number of a row, with its address and the value that it must have. */
typedef bool each_fn(float *at, float expected);

static bool set(float *at, float expected) {
  *at = expected;
  return true;
}

static bool is(float *at, float expected) {
  return *at == expected;
}

/* Calls `each` for every number of a model's rows. These are the rows of the whole model from `begin` on. */
static bool go_through(pags_train_model *m, int64_t model, int64_t begin, each_fn *each) {
  bool right = true;
  for (int64_t i = 0; i < m->gaussians.count; i++) {
    int plane = 0;
    for (int p = 0; p < pags_plane_count(1); p++) {
      right &= each(pags_plane(&m->gaussians, p) + i, value(model, plane++, begin + i));
      right &= each(pags_plane(&m->adam.first, p) + i, value(model, plane++, begin + i));
      right &= each(pags_plane(&m->adam.second, p) + i, value(model, plane++, begin + i));
    }
    for (int p = 0; model == 1 && p < pags_fourier_planes(&m->gaussians); p++) {
      right &= each(m->gaussians.fourier + p * m->gaussians.stride + i, value(model, plane++, begin + i));
      right &= each(m->adam.first.fourier + p * m->adam.first.stride + i, value(model, plane++, begin + i));
      right &= each(m->adam.second.fourier + p * m->adam.second.stride + i, value(model, plane++, begin + i));
    }
    right &= each(&m->density.gradient[i], value(model, plane++, begin + i));
    if (model == 0)
      right &= each(&m->gaussians.s_sem[i], value(model, plane++, begin + i));
  }
  return right;
}

/* Makes the state of a rank that owns the rows [begin[m], end[m]) of each model m. Only rank 0 has data other than
 * rows. */
static pags_result make(int rank, const int64_t *begin, const int64_t *end, pags_train_state *state) {
  pags_train_config config = pags_train_config_default();
  config.color.sh_degree = 1;
  config.picture.cluster_size = SIZE;
  config.objects.box_prune = 1;
  const pags_schedule schedule = pags_schedule_make(&config, 2.5, 44);
  PAGS_TRY(pags_state_create(state, &schedule, 1000, MODELS));
  PAGS_TRY(pags_track_poses_create(&state->tracks, dataset));
  state->tracks.objects[1].keyframes[2].translation[1] = rank == 0 ? 0.25 : 0;
  for (int64_t k = 0; k < MODELS; k++) {
    pags_gaussians g;
    PAGS_TRY(pags_gaussians_create(&g, end[k] - begin[k], 1));
    g.alpha_min = (float)config.picture.alpha_min;
    if (k == 0)
      PAGS_TRY(pags_gaussians_add_s_sem(&g));
    if (k == 1)
      PAGS_TRY(pags_gaussians_add_fourier(&g, 1));
    PAGS_TRY(pags_state_add_model(state, k - 1, 2.5 + (double)k, &g));
    pags_train_model *m = &state->models[k];
    if (k == 1) {
      PAGS_TRY(pags_gaussians_add_fourier(&m->adam.first, 1));
      PAGS_TRY(pags_gaussians_add_fourier(&m->adam.second, 1));
    }
    m->fourier_gain = 0.5;
    go_through(m, k, begin[k], set);
    for (int64_t i = 0; i < m->gaussians.count; i++)
      m->density.seen[i] = (int32_t)(begin[k] + i);
    for (int64_t c = 0; c < m->adam.cluster_count; c++) {
      m->adam.moment_step[c] = (int32_t)(10 + begin[k] / SIZE + c);
      m->adam.param_step[c] = (int32_t)(200 + begin[k] / SIZE + c);
    }
  }
  pags_state_set_step(state, 900);
  state->loss = rank == 0 ? 0.125 : 0;
  return PAGS_OK;
}

static bool is_right(pags_train_state *state, const int64_t *begin, const int64_t *end) {
  bool right = state->tracks.objects[1].keyframes[2].translation[1] == 0.25 && state->step == 900 &&
               state->stop == 1000 && state->loss == 0.125 && state->model_count == MODELS &&
               state->schedule.extent == 2.5 && state->schedule.views == 44;
  for (int64_t k = 0; right && k < MODELS; k++) {
    pags_train_model *m = &state->models[k];
    right = (k == 0 || m->half_size[0] == 0.5 * state->tracks.objects[k - 1].size[0]) && m->object == k - 1 &&
            m->schedule.extent == 2.5 + (double)k && m->step == 900 && m->gaussians.count == end[k] - begin[k] &&
            go_through(m, k, begin[k], is) &&
            (m->gaussians.count == 0 || (m->fourier_gain == 0.5 && (m->gaussians.fourier != NULL) == (k == 1)));
    for (int64_t i = 0; right && i < m->gaussians.count; i++)
      right = m->density.seen[i] == begin[k] + i;
    for (int64_t c = 0; right && c < m->adam.cluster_count; c++)
      right = m->adam.moment_step[c] == 10 + begin[k] / SIZE + c && m->adam.param_step[c] == 200 + begin[k] / SIZE + c;
  }
  return right;
}

static void find_own(const pags_transport *transport, int64_t begin[MODELS], int64_t end[MODELS]) {
  int64_t all[MODELS * (MOST_RANKS + 1)];
  const int ranks = pags_transport_ranks(transport), rank = pags_transport_rank(transport);
  cut(rows_of, MODELS, SIZE, ranks, all);
  for (int m = 0; m < MODELS; m++) {
    begin[m] = all[m * (ranks + 1) + rank];
    end[m] = all[m * (ranks + 1) + rank + 1];
  }
}

static const char *save(pags_transport *transport, void *user) {
  const uint64_t *fingerprint = user;
  int64_t begin[MODELS], end[MODELS];
  pags_train_state state;
  find_own(transport, begin, end);
  EXPECT(make(pags_transport_rank(transport), begin, end, &state) == PAGS_OK);
  const pags_result result = pags_shards_save(path, transport, &state, *fingerprint);
  pags_state_destroy(&state);
  EXPECT(result == PAGS_OK);
  return "";
}

static const char *load(pags_transport *transport, void *user) {
  const uint64_t *expected = user;
  uint64_t fingerprint;
  int64_t begin[MODELS], end[MODELS];
  pags_train_state state;
  find_own(transport, begin, end);
  EXPECT(pags_shards_load(path, transport, cut, dataset, &state, &fingerprint) == PAGS_OK);
  const bool right = is_right(&state, begin, end) && fingerprint == *expected;
  pags_state_destroy(&state);
  EXPECT(right);
  return "";
}

static int64_t count_files(void) {
  pags_dir_list list;
  assert_int_equal(pags_dir_list_read(folder, &list), PAGS_OK);
  const int64_t count = list.count;
  pags_dir_list_destroy(&list);
  return count;
}

static void any_number_of_ranks_reads_shards(void **unused) {
  (void)unused;
  for (int writers = 1; writers <= MOST_RANKS; writers++)
    for (int round = 0; round < 2; round++) {
      uint64_t fingerprint = (uint64_t)(100 * writers + round);
      cut_seed = fingerprint;
      assert_true(run_ranks(writers, 0, 60, save, &fingerprint));
      assert_int_equal(count_files(), writers == 1 ? 1 : 1 + writers); /* no file of an earlier checkpoint is left */
      for (int readers = 1; readers <= MOST_RANKS; readers++) {
        cut_seed = fingerprint + (uint64_t)(1000 * readers);
        assert_true(run_ranks(readers, 0, 60, load, &fingerprint));
      }
    }
}

/* ---- Failures ---- */

static char *newest_shard(int rank) {
  static char name[300];
  for (int generation = 40; generation > 0; generation--) {
    snprintf(name, sizeof name, "%s.g%d.%d", path, generation, rank);
    if (pags_file_exists(name))
      return name;
  }
  return NULL;
}

/* A folder has the name of rank 1's next shard, so rank 1 can't write this shard. */
static const char *save_and_fail(pags_transport *transport, void *user) {
  (void)user;
  int64_t begin[MODELS], end[MODELS];
  pags_train_state state;
  find_own(transport, begin, end);
  EXPECT(make(pags_transport_rank(transport), begin, end, &state) == PAGS_OK);
  const pags_result result = pags_shards_save(path, transport, &state, 8);
  pags_state_destroy(&state);
  EXPECT(result == PAGS_ERROR_IO && strstr(pags_error_message(), "rank 1: "));
  return "";
}

static void failed_save_keeps_the_old_checkpoint(void **unused) {
  (void)unused;
  uint64_t fingerprint = 7;
  assert_true(run_ranks(3, 0, 60, save, &fingerprint));
  const char *name = newest_shard(1);
  assert_non_null(name);
  int generation = 0;
  assert_int_equal(sscanf(name + strlen(path), ".g%d", &generation), 1);
  char blocked[300];
  snprintf(blocked, sizeof blocked, "%s.g%d.1.part", path, generation + 1);
  assert_true(pags_port_make_folder(blocked));
  const int64_t before = count_files();
  assert_true(run_ranks(3, 0, 60, save_and_fail, NULL));
  assert_int_equal(count_files(), before);
  assert_true(run_ranks(2, 0, 60, load, &fingerprint));
  assert_true(pags_port_remove_folder(blocked));
  assert_true(run_ranks(3, 0, 60, save, &fingerprint)); /* saving succeeds without this folder */
  assert_int_equal(count_files(), before - 1);
}

static const char *fails(pags_transport *transport, void *user) {
  const char *expected = user;
  uint64_t fingerprint;
  pags_train_state state;
  EXPECT(pags_shards_load(path, transport, cut, dataset, &state, &fingerprint) == PAGS_ERROR_FORMAT);
  EXPECT(strstr(pags_error_message(), expected));
  return "";
}

static void damage_is_found(void **unused) {
  (void)unused;
  uint64_t fingerprint = 9;
  cut_seed = 5;
  assert_true(run_ranks(3, 0, 60, save, &fingerprint));
  char shards[3][300];
  for (int r = 0; r < 3; r++)
    snprintf(shards[r], sizeof shards[r], "%s", newest_shard(r));
  uint8_t *bytes, *other;
  size_t size, other_size;
  assert_int_equal(pags_file_read(shards[2], &bytes, &size), PAGS_OK);
  assert_int_equal(pags_file_read(shards[1], &other, &other_size), PAGS_OK);
  bytes[size / 2] ^= 1;
  assert_int_equal(pags_file_write(shards[2], bytes, size), PAGS_OK);
  assert_true(run_ranks(1, 0, 60, fails, (void *)"wrong CRC"));
  assert_true(run_ranks(4, 0, 60, fails, (void *)"wrong CRC"));
  assert_int_equal(pags_file_write(shards[2], bytes, size - 1), PAGS_OK);
  assert_true(run_ranks(2, 0, 60, fails, (void *)"as the manifest says"));
  free(bytes);
  free(other);
  /* manifests that are cut off anywhere */
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  for (size_t cut_off = 1; cut_off + 2 < size; cut_off += 1 + size / 20) {
    assert_int_equal(pags_file_write(path, bytes, cut_off), PAGS_OK);
    assert_true(run_ranks(2, 0, 60, fails, (void *)path));
  }
  free(bytes);
}

static int set_up(void **state) {
  static scratch s;
  const pags_dataset_options options = tree_options("waymo");
  scratch_begin(&s);
  *state = &s;
  tree_write(&s, &tree_kinds[0]);
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  assert_int_equal(pags_dataset_object_count(dataset), MODELS - 1);
  snprintf(folder, sizeof folder, "%s/run", s.folder);
  snprintf(path, sizeof path, "%s/checkpoint.pags", folder);
  return pags_make_dirs(folder) == PAGS_OK ? 0 : -1;
}

static int tear_down(void **state) {
  pags_dataset_close(dataset);
  scratch_end(*state);
  return 0;
}

int main(void) {
  system_prefer_memory();
  const struct CMUnitTest tests[] = {
      cmocka_unit_test_setup_teardown(any_number_of_ranks_reads_shards, set_up, tear_down),
      cmocka_unit_test_setup_teardown(failed_save_keeps_the_old_checkpoint, set_up, tear_down),
      cmocka_unit_test_setup_teardown(damage_is_found, set_up, tear_down),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
