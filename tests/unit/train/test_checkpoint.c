/* SPDX-License-Identifier: Apache-2.0 */
/* Tests checkpoints: the complete state of a run is restored, and damaged files are refused. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/file.h"
#include "base/rng.h"
#include "system.h"
#include "train/checkpoint.h"
#include "train/config.h"

enum { ROWS = 150, CLUSTERS = 3 };

static char folder[200], path[256];

static float *fill(float *x, uint64_t purpose) {
  for (int i = 0; i < ROWS; i++)
    x[i] = (float)pags_rng_uniform(1, purpose, (uint64_t)i);
  return x;
}

static void make(pags_train_state *state) {
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = 777;
  config.color.sh_degree = 1;
  config.density.long_axis_split = 0;
  pags_schedule schedule = pags_schedule_make(&config, 2.5, 44);
  pags_gaussians g;
  assert_int_equal(pags_gaussians_create(&g, ROWS, 1), PAGS_OK);
  for (int p = 0; p < pags_plane_count(1); p++)
    fill(pags_plane(&g, p), (uint64_t)p);
  assert_int_equal(pags_state_create(state, &schedule, 1000, 1), PAGS_OK);
  assert_int_equal(pags_state_add_model(state, -1, 2.5, &g), PAGS_OK);
  pags_train_model *m = &state->models[0];
  for (int p = 0; p < pags_plane_count(1); p++) {
    fill(pags_plane(&m->adam.first, p), 100 + (uint64_t)p);
    fill(pags_plane(&m->adam.second, p), 200 + (uint64_t)p);
  }
  fill(m->density.gradient, 300);
  m->density.seen[77] = 5;
  pags_state_set_step(state, 900);
  state->resets = 2;
  state->loss = 0.125;
  state->mse = 0.25;
  for (int c = 0; c < CLUSTERS; c++) {
    m->adam.moment_step[c] = 800 + c;
    m->adam.param_step[c] = 850 + c;
  }
}

static void a_checkpoint_restores_the_state(void **unused) {
  (void)unused;
  pags_train_state a, b;
  uint64_t fingerprint = 0;
  make(&a);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 0x1234567890abcdefu), PAGS_OK);
  assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_OK);
  assert_true(fingerprint == 0x1234567890abcdefu);
  assert_true(b.step == 900 && b.stop == 1000 && b.resets == 2 && b.loss == 0.125 && b.mse == 0.25);
  assert_true(b.schedule.extent == 2.5 && b.schedule.views == 44 && b.schedule.length == 777);
  assert_int_equal(b.schedule.config.density.long_axis_split, 0);
  const pags_train_model *m = &a.models[0], *n = &b.models[0];
  assert_int_equal(n->gaussians.count, ROWS);
  for (int p = 0; p < pags_plane_count(1); p++) {
    assert_memory_equal(pags_plane(&m->gaussians, p), pags_plane(&n->gaussians, p), ROWS * sizeof(float));
    assert_memory_equal(pags_plane(&m->adam.first, p), pags_plane(&n->adam.first, p), ROWS * sizeof(float));
    assert_memory_equal(pags_plane(&m->adam.second, p), pags_plane(&n->adam.second, p), ROWS * sizeof(float));
  }
  assert_memory_equal(m->density.gradient, n->density.gradient, ROWS * sizeof(float));
  assert_memory_equal(m->density.seen, n->density.seen, ROWS * sizeof(int32_t));
  assert_memory_equal(m->adam.moment_step, n->adam.moment_step, CLUSTERS * sizeof(int32_t));
  assert_memory_equal(m->adam.param_step, n->adam.param_step, CLUSTERS * sizeof(int32_t));
  pags_state_destroy(&a);
  pags_state_destroy(&b);
}

/* A saved file depends only on the state: it holds no time and no uninitialised padding. */
static void same_state_same_bytes(void **unused) {
  (void)unused;
  pags_train_state a, b;
  uint64_t fingerprint;
  uint8_t *first, *second;
  size_t first_size, second_size;
  make(&a);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
  assert_int_equal(pags_file_read(path, &first, &first_size), PAGS_OK);
  assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_OK);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &b, fingerprint), PAGS_OK);
  assert_int_equal(pags_file_read(path, &second, &second_size), PAGS_OK);
  assert_int_equal(first_size, second_size);
  assert_memory_equal(first, second, first_size);
  free(first);
  free(second);
  pags_state_destroy(&a);
  pags_state_destroy(&b);
}

static void damaged_files_are_refused(void **unused) {
  (void)unused;
  pags_train_state a, b;
  uint64_t fingerprint;
  uint8_t *bytes;
  size_t size;
  make(&a);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  for (size_t at = 0; at < size; at += 1 + size / 97) { /* one bit is changed */
    bytes[at] ^= 0x10;
    assert_int_equal(pags_file_write(path, bytes, size), PAGS_OK);
    assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_ERROR_FORMAT);
    assert_non_null(strstr(pags_error_message(), path));
    bytes[at] ^= 0x10;
  }
  for (size_t cut = 0; cut < size; cut += 1 + size / 41) { /* the file is truncated */
    assert_int_equal(pags_file_write(path, bytes, cut), PAGS_OK);
    assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_ERROR_FORMAT);
  }
  free(bytes);
  pags_state_destroy(&a);
}

/* A file with a valid CRC whose step numbers are impossible must be refused, as the optimiser would use them. */
static void impossible_steps_are_refused(void **unused) {
  (void)unused;
  pags_train_state a, b;
  uint64_t fingerprint;
  make(&a);
  a.models[0].adam.param_step[1] = 901;
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
  assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_ERROR_FORMAT);
  pags_state_destroy(&a);
}

/* A checkpoint of a few kilobytes whose step or view counts would make the loader allocate gigabytes, or the
 * schedule's sums overflow, is refused. */
static void impossible_runs_are_refused(void **unused) {
  (void)unused;
  pags_train_state a, b;
  uint64_t fingerprint;
  make(&a);
  const struct {
    int64_t *number, value;
  } cases[] = {
      {&a.stop, PAGS_CONFIG_STEPS + 1},
      {&a.schedule.views, INT64_MAX / 2},
      {&a.resets, a.step + 1},
      {&a.resets, -1},
      {&a.cap, -1},
      {&a.clocked, 2},
      {&a.lidar_points, -1},
  };
  for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
    int64_t sound = *cases[i].number;
    *cases[i].number = cases[i].value;
    assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
    assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_ERROR_FORMAT);
    *cases[i].number = sound;
  }
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
  assert_int_equal(pags_checkpoint_load(path, NULL, &b, &fingerprint), PAGS_OK);
  pags_state_destroy(&b);
  pags_state_destroy(&a);
}

/* Impossible counts with a valid CRC are refused when the file is inspected, which adds counts without loading rows. */
static void impossible_counts_are_refused(void **unused) {
  (void)unused;
  pags_train_state a;
  pags_checkpoint_facts facts;
  uint8_t *bytes;
  size_t size, at = 0;
  make(&a);
  assert_int_equal(pags_checkpoint_save(path, NULL, false, &a, 1), PAGS_OK);
  pags_state_destroy(&a);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  while (memcmp(bytes + at, "MODL", 4) != 0)
    at++;
  bytes[at + 12 + 8 + 7] = 0x40; /* the second number is the count */
  const size_t section = 12 + bytes[at + 4];
  const uint32_t crc = (uint32_t)crc32(0, bytes + at, (uInt)section);
  memcpy(bytes + at + section, &crc, sizeof crc);
  assert_int_equal(pags_file_write(path, bytes, size), PAGS_OK);
  assert_int_equal(pags_checkpoint_inspect(path, &facts), PAGS_ERROR_FORMAT);
  free(bytes);
}

static int make_path(void **unused) {
  (void)unused;
  if (!system_make_scratch(folder, sizeof folder))
    return -1;
  snprintf(path, sizeof path, "%s/checkpoint", folder);
  return 0;
}
static int remove_path(void **unused) {
  (void)unused;
  return pags_remove_tree(folder) == PAGS_OK ? 0 : -1;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_checkpoint_restores_the_state), cmocka_unit_test(same_state_same_bytes),
      cmocka_unit_test(damaged_files_are_refused),       cmocka_unit_test(impossible_steps_are_refused),
      cmocka_unit_test(impossible_runs_are_refused),     cmocka_unit_test(impossible_counts_are_refused),
  };
  return cmocka_run_group_tests(tests, make_path, remove_path);
}
