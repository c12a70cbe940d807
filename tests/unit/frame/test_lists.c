/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the tiles' splat lists: the sort by depth key, and the lists of whole frames, read from the frame's
 * internals. Each list is sorted front to back by (bits of z, id). The entries of a splat have its key; for a backward
 * pass they are numbered 0, 1, 2, ... by rank without gaps. This holds for any depths, ids and number of threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "frame/stages.h"

/* Random numbers: splitmix64. */
static uint64_t state;
static uint32_t next_u32(void) {
  uint64_t z = (state += 0x9E3779B97F4A7C15u);
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
  z = (z ^ z >> 27) * 0x94D049BB133111EBu;
  return (uint32_t)(z >> 32);
}
static float uniform(float lo, float hi) {
  return lo + (hi - lo) * (float)(next_u32() >> 8) * 0x1p-24f;
}

static int compare_keys(const void *a, const void *b) {
  const depth_key *const x = a, *const y = b;
  return x->key != y->key ? (x->key > y->key) - (x->key < y->key) : (x->splat > y->splat) - (x->splat < y->splat);
}

/* The sort is stable and by key, for lengths around those at which it changes its algorithm and for every number of
 * significant bits. */
static void test_keys(void **unused) {
  (void)unused;
  static const int64_t counts[] = {0, 1, 2, 3, 31, 32, 33, 34, 255, 256, 257, 1000, 20000};
  enum { MOST = 20000 };
  depth_key *const keys = malloc(3 * MOST * sizeof *keys), *const spare = keys + MOST, *const want = spare + MOST;
  assert_non_null(keys);
  for (size_t n = 0; n < sizeof counts / sizeof *counts; n++)
    for (int bits = 0; bits <= 32; bits++) {
      const uint32_t base = bits < 32 ? next_u32() >> 1 >> (bits == 31) : 0;
      for (int64_t i = 0; i < counts[n]; i++)
        keys[i] = (depth_key){.key = base + (bits ? next_u32() >> (32 - bits) : 0), .splat = (uint32_t)i};
      memcpy(want, keys, (size_t)counts[n] * sizeof *keys);
      qsort(want, (size_t)counts[n], sizeof *want, compare_keys);
      const depth_key *const got = pags_frame_sort_keys(keys, spare, counts[n]);
      assert_memory_equal(got, want, (size_t)counts[n] * sizeof *want);
    }
  free(keys);
}

typedef struct crowd {
  pags_gaussians gaussians;
  pags_clusters clusters;
  int32_t *id; /* NULL: ids are the row numbers */
} crowd;

/* Gaussians in front of a camera at the origin that looks along z, at `depths` different values of z (0: all
 * different). At z = 1 they lie within `reach` of the corner (-1, -1) in both directions. */
static crowd crowd_create(int64_t count, int depths, float reach, bool own_ids) {
  crowd c = {.id = own_ids ? malloc((size_t)(count + 1) * sizeof *c.id) : NULL};
  assert_int_equal(pags_gaussians_create(&c.gaussians, count, 0), PAGS_OK);
  for (int64_t i = 0; i < count; i++) {
    const float z = depths ? (float)(2 + next_u32() % (uint32_t)depths) : uniform(0.5f, 50);
    const float values[] = {(uniform(0, reach) - 1) * z, (uniform(0, reach) - 1) * z, z};
    for (int k = 0; k < 3; k++) {
      pags_plane(&c.gaussians, PAGS_MEAN + k)[i] = values[k];
      pags_plane(&c.gaussians, PAGS_SCALE + k)[i] = logf(uniform(0.002f, 0.05f) * z);
      pags_plane(&c.gaussians, PAGS_SH + k)[i] = uniform(-1, 1);
    }
    for (int k = 0; k < 4; k++)
      pags_plane(&c.gaussians, PAGS_ROTATION + k)[i] = uniform(-1, 1);
    pags_plane(&c.gaussians, PAGS_OPACITY)[i] = uniform(-4, 4);
    if (c.id)
      c.id[i] = (int32_t)(count - 1 - i);
  }
  assert_int_equal(pags_clusters_create(&c.clusters, count, 64), PAGS_OK);
  pags_clusters_update(&c.clusters, &c.gaussians, 0, c.clusters.count);
  return c;
}

static void crowd_destroy(crowd *c) {
  pags_clusters_destroy(&c->clusters);
  pags_gaussians_destroy(&c->gaussians);
  free(c->id);
}

static void render(pags_frame *frame, const crowd *c, int width, int height, bool backward) {
  const pags_part part = {.gaussians = &c->gaussians,
                          .clusters = &c->clusters,
                          .id = c->id,
                          .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  const pags_camera camera = {.width = width,
                              .height = height,
                              .fx = 0.5 * width,
                              .fy = 0.5 * height,
                              .cx = 0.5 * width,
                              .cy = 0.5 * height,
                              .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  pags_frame_options options = pags_frame_options_default();
  options.keep_for_backward = backward;
  pags_picture picture;
  assert_int_equal(pags_frame_render(frame, &part, 1, &camera, &options, NULL, NULL, &picture), PAGS_OK);
}

static int64_t tiles_of(const pags_frame *f) {
  return (int64_t)f->tiles_x * f->tiles_y;
}

static void check_list(const pags_frame *f, int64_t tile) {
  for (int64_t i = f->tile_start[tile] + 1; i < f->tile_start[tile + 1]; i++) {
    const uint32_t before = f->entries[i - 1].splat, here = f->entries[i].splat;
    assert_true(f->keys[before] < f->keys[here] ||
                (f->keys[before] == f->keys[here] && f->splats[before].id < f->splats[here].id));
  }
}

/* Checks every tile's list; returns the length of the longest. */
static int64_t check_lists(const pags_frame *f) {
  int64_t pairs = 0, longest = 0;
  for (int64_t i = 0; i < f->dense_count; i++)
    if (f->keys[i] != UINT32_MAX)
      pairs += f->splats[i].tiles;
  assert_int_equal(f->tile_start[0], 0);
  assert_int_equal(f->tile_start[tiles_of(f)], pairs);
  uint32_t *const next_rank = calloc((size_t)f->dense_count + 1, sizeof *next_rank);
  assert_non_null(next_rank);
  for (int64_t tile = 0; tile < tiles_of(f); tile++) {
    check_list(f, tile);
    for (int64_t i = f->tile_start[tile]; i < f->tile_start[tile + 1]; i++) {
      const uint32_t splat = f->entries[i].splat, rank = next_rank[splat]++;
      assert_int_equal(f->entries[i].rank, f->options.keep_for_backward ? rank : f->keys[splat]);
    }
    const int64_t length = f->tile_start[tile + 1] - f->tile_start[tile];
    longest = length > longest ? length : longest;
  }
  for (int64_t i = 0; i < f->dense_count; i++)
    assert_int_equal(next_rank[i], f->keys[i] != UINT32_MAX ? f->splats[i].tiles : 0);
  free(next_rank);
  return longest;
}

/* Checks that the slots of each splat (one for each tile it covers) follow those of the previous splat without a
 * gap. */
static void check_slots(const pags_frame *f) {
  int64_t place = 0;
  for (int64_t i = 0; i <= f->dense_count; i++) {
    assert_int_equal(f->slot_start[i], place);
    if (i < f->dense_count && f->keys[i] != UINT32_MAX)
      place += f->splats[i].tiles;
  }
}

/* Renders with several numbers of threads and checks the lists; returns the length of the longest. */
static int64_t check_crowd(crowd c, int width, int height) {
  static const int threads[] = {1, 2, 7};
  pags_entry *first = NULL;
  int64_t longest = 0;
  for (int t = 0; t < 3; t++) {
    pags_tasks *const tasks = pags_tasks_create(threads[t]);
    pags_frame *f;
    assert_int_equal(pags_frame_create(tasks, &f), PAGS_OK);
    render(f, &c, width, height, false);
    longest = check_lists(f);
    const size_t size = (size_t)f->tile_start[tiles_of(f)] * sizeof *first;
    if (!first)
      first = memcpy(malloc(size + 1), f->entries, size);
    assert_memory_equal(first, f->entries, size);
    render(f, &c, width, height, true);
    check_lists(f);
    for (size_t i = 0; i < size / sizeof *first; i++)
      assert_int_equal(first[i].splat, f->entries[i].splat);
    check_slots(f);
    render(f, &c, width, height, true);
    const uint64_t settled = pags_frame_heap_calls(f);
    render(f, &c, width, height, true);
    assert_int_equal(pags_frame_heap_calls(f), settled);
    pags_frame_destroy(f);
    pags_tasks_destroy(tasks);
  }
  free(first);
  crowd_destroy(&c);
  return longest;
}

static void test_depths(void **unused) {
  (void)unused;
  for (int own = 0; own < 2; own++) {
    assert_true(check_crowd(crowd_create(40000, 0, 2, own), 150, 100) > 512);
    assert_true(check_crowd(crowd_create(3000, 0, 2, own), 300, 200) < 256);
    /* Walls of Gaussians of equal depth. */
    assert_true(check_crowd(crowd_create(20000, 3, 2, own), 150, 100) > 512);
    assert_true(check_crowd(crowd_create(5000, 1, 2, own), 150, 100) > 32);
  }
}

/* All Gaussians in one list: in a picture of one tile, and in the corner of a large picture whose other tiles are
 * empty. */
static void test_one_list(void **unused) {
  (void)unused;
  for (int own = 0; own < 2; own++) {
    assert_true(check_crowd(crowd_create(40000, 0, 2, own), 16, 16) > 20000);
    assert_true(check_crowd(crowd_create(40000, 2, 2, own), 13, 9) > 20000);
    assert_true(check_crowd(crowd_create(20000, 0, 0.02f, own), 640, 480) > 5000);
  }
}

static void test_few(void **unused) {
  (void)unused;
  assert_int_equal(check_crowd(crowd_create(0, 0, 2, false), 64, 48), 0);
  for (int k = 0; k < 20; k++)
    check_crowd(crowd_create(1 + k % 3, k % 2, 2, k % 4 == 0), 64, 48);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_keys),
      cmocka_unit_test(test_depths),
      cmocka_unit_test(test_one_list),
      cmocka_unit_test(test_few),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
