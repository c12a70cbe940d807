/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the arena allocator: alignment, marks, overflow, folding of its chunks into one, and no heap call in steady
 * state. */
#include <pags/tasks.h>

#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

static void blocks_are_aligned_and_apart(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  unsigned char *blocks[100];
  for (size_t i = 0; i < 100; i++) {
    blocks[i] = pags_arena_alloc(arena, i, 37);
    assert_non_null(blocks[i]);
    assert_int_equal((uintptr_t)blocks[i] % 64, 0);
    memset(blocks[i], (int)i, i * 37);
  }
  for (size_t i = 0; i < 100; i++)
    for (size_t j = 0; j < i * 37; j++)
      assert_int_equal(blocks[i][j], i);
  pags_arena_destroy(arena);
}

static void empty_blocks_have_distinct_addresses(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  void *a = pags_arena_alloc(arena, 0, 8);
  void *b = pags_arena_alloc(arena, 8, 0);
  assert_non_null(a);
  assert_non_null(b);
  assert_ptr_not_equal(a, b);
  pags_arena_destroy(arena);
}

static void impossible_sizes_are_refused(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  assert_null(pags_arena_alloc(arena, SIZE_MAX / 2, 3));
  assert_null(pags_arena_alloc(arena, SIZE_MAX, 1));
  assert_null(pags_arena_alloc(arena, SIZE_MAX / 8 + 1, 8));
  assert_int_equal(pags_arena_high_water(arena), 0);
  assert_non_null(pags_arena_alloc(arena, 1, 1)); /* the arena is still usable */
  pags_arena_destroy(arena);
}

/* Allocates the blocks of one frame, most of them larger than the arena's first chunk. */
static void fill(pags_arena *arena, size_t scale) {
  for (size_t i = 1; i <= 20; i++) {
    unsigned char *block = pags_arena_alloc(arena, i * scale, 1000);
    assert_non_null(block);
    block[0] = block[i * scale * 1000 - 1] = 1;
  }
}

static void steady_state_calls_no_heap(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  fill(arena, 50);
  pags_arena_reset(arena);
  uint64_t after_first = pags_arena_heap_calls(arena);
  assert_true(after_first > 2);
  for (int frame = 0; frame < 100; frame++) {
    fill(arena, 50);
    pags_arena_reset(arena);
  }
  assert_int_equal(pags_arena_heap_calls(arena), after_first);
  fill(arena, 500);
  assert_true(pags_arena_heap_calls(arena) > after_first);
  pags_arena_destroy(arena);
}

static void a_reset_folds_the_chunks(void **state) {
  (void)state;
  /* For some of these sizes the last chunk alone would hold the request even if chunks were not folded into one. */
  for (size_t scale = 10; scale < 80; scale++) {
    pags_arena *arena = pags_arena_create();
    fill(arena, scale);
    pags_arena_reset(arena);
    uint64_t calls = pags_arena_heap_calls(arena);
    /* 64: the gap that the arena leaves between blocks under sanitizers. */
    assert_non_null(pags_arena_alloc(arena, pags_arena_high_water(arena) - 64, 1));
    assert_int_equal(pags_arena_heap_calls(arena), calls);
    pags_arena_destroy(arena);
  }
}

static void marks_release_later_blocks(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  pags_arena_mark empty = pags_arena_save(arena);
  char *kept = pags_arena_alloc(arena, 10, 1);
  memcpy(kept, "keep this", 10);
  pags_arena_mark mark = pags_arena_save(arena);
  void *first = pags_arena_alloc(arena, 5, 100);
  for (int round = 0; round < 50; round++) {
    pags_arena_release(arena, mark);
    assert_ptr_equal(pags_arena_alloc(arena, 5, 100), first);
    fill(arena, 50);
  }
  uint64_t calls = pags_arena_heap_calls(arena);
  pags_arena_release(arena, mark);
  fill(arena, 50);
  assert_int_equal(pags_arena_heap_calls(arena), calls); /* chunks allocated after the mark were kept for reuse */
  assert_string_equal(kept, "keep this");
  pags_arena_release(arena, empty);
  assert_ptr_equal(pags_arena_alloc(arena, 1, 1), kept);
  pags_arena_destroy(arena);
}

static void high_water_is_the_most_at_once(void **state) {
  (void)state;
  pags_arena *arena = pags_arena_create();
  pags_arena_alloc(arena, 1000, 1000);
  pags_arena_reset(arena);
  pags_arena_alloc(arena, 1000, 500);
  pags_arena_mark mark = pags_arena_save(arena);
  pags_arena_alloc(arena, 1000, 100);
  pags_arena_release(arena, mark);
  pags_arena_alloc(arena, 1000, 100);
  size_t most = pags_arena_high_water(arena);
  assert_true(most >= 1000 * 1000 && most < 1000 * 1000 + 256);
  pags_arena_destroy(arena);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(blocks_are_aligned_and_apart),   cmocka_unit_test(empty_blocks_have_distinct_addresses),
      cmocka_unit_test(impossible_sizes_are_refused),   cmocka_unit_test(steady_state_calls_no_heap),
      cmocka_unit_test(a_reset_folds_the_chunks),       cmocka_unit_test(marks_release_later_blocks),
      cmocka_unit_test(high_water_is_the_most_at_once),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
