/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the initial points of a driving scene's training: their positions, their colours, and the object to which
 * they belong. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "init/driving_points.h"
#include "train/config.h"
#include "unit/driving_stub.h"

/* Makes the points from at most `most` LiDAR points of the background; 0: the default number. */
static pags_driving_points make_of(int lidar, int most, int threads) {
  pags_dataset *d = stub_open();
  pags_tasks *tasks = pags_tasks_create(threads);
  pags_train_config config = pags_train_config_default();
  config = pags_config_resolve(&config, true);
  if (most > 0)
    config.start.lidar_points = most;
  pags_driving_points start;
  pags_photo_cache *photos;
  assert_int_equal(pags_photo_cache_create(d, tasks, (uint64_t)64 << 20, &photos), PAGS_OK);
  assert_int_equal(pags_driving_points_create(d, &config, lidar, photos, tasks, &start), PAGS_OK);
  pags_photo_cache_destroy(photos);
  pags_tasks_destroy(tasks);
  stub_close(d);
  return start;
}

static pags_driving_points make(int lidar, int threads) {
  return make_of(lidar, 0, threads);
}

static int is_colour(const uint8_t *rgb, const uint8_t *wanted) {
  return abs(rgb[0] - wanted[0]) <= 20 && abs(rgb[1] - wanted[1]) <= 20 && abs(rgb[2] - wanted[2]) <= 20;
}

/* Returns the colour of the surface that a background point lies on; NULL if it lies on none. */
static const uint8_t *surface(const float *p) {
  if (fabsf(p[0] - 15) < 1.1f && fabsf(p[1] - 6) < 1.1f && p[2] > 0.07f && p[2] < 2.1f)
    return stub_colours[STUB_CRATE];
  if (fabsf(p[2]) < 0.15f)
    return stub_road;
  return fabsf(p[0] - 30) < 0.1f ? stub_wall : NULL;
}

static void background_lies_on_its_surfaces(void **state) {
  (void)state;
  pags_driving_points start = make(1, 1);
  const pags_point_set *b = &start.background;
  int64_t elsewhere = 0, miscoloured = 0, parked = 0;
  assert_true(start.lidar_points > 3000);
  for (int64_t i = 0; i < start.lidar_points; i++) {
    const uint8_t *wanted = surface(b->xyz + 3 * i);
    elsewhere += !wanted;
    miscoloured += wanted && !is_colour(b->rgb + 3 * i, wanted);
    parked += b->object[i] == STUB_CRATE;
    assert_true(b->object[i] == STUB_CRATE || b->object[i] == -1);
    if (b->object[i] == STUB_CRATE)
      assert_ptr_equal(wanted, stub_colours[STUB_CRATE]);
  }
  assert_int_equal(elsewhere, 0);
  assert_true((double)miscoloured < 0.04 * (double)start.lidar_points);
  assert_true(parked > 50);
  pags_driving_points_destroy(&start);
}

static void fewer_lidar_points_are_means_of_larger_voxels(void **state) {
  (void)state;
  pags_driving_points all = make(1, 2), few = make_of(1, 1000, 2);
  int64_t off = 0;
  assert_true(all.lidar_points > 3000);
  assert_true(few.lidar_points > 500 && few.lidar_points <= 1000);
  for (int64_t i = 0; i < few.lidar_points; i++)
    off += surface(few.background.xyz + 3 * i) == NULL;
  assert_true((double)off < 0.05 * (double)few.lidar_points);
  pags_driving_points_destroy(&all);
  pags_driving_points_destroy(&few);
}

static void moving_objects_have_separate_points(void **state) {
  (void)state;
  pags_driving_points start = make(1, 1);
  const pags_point_set *car = &start.objects[STUB_CAR];
  int64_t red = 0, left = 0;
  assert_int_equal(start.object_count, STUB_OBJECTS);
  assert_true(car->count > 300);
  assert_null(car->object);
  for (int64_t i = 0; i < car->count; i++) {
    const float *p = car->xyz + 3 * i;
    assert_true(fabsf(p[0]) < 2.11f && fabsf(p[1]) < 1.11f && fabsf(p[2]) < 0.91f);
    red += is_colour(car->rgb + 3 * i, stub_colours[STUB_CAR]);
    left += p[1] > 0.5f;
  }
  assert_true((double)red > 0.95 * (double)car->count);
  /* The LiDAR sees only the car's right side; points of the left side are its mirror image. */
  assert_true(left > 50);
  assert_true(car->count - left > 50);
  assert_int_equal(start.objects[STUB_CRATE].count, 0);
  pags_driving_points_destroy(&start);
}

static void objects_without_lidar_are_filled_if_visible(void **state) {
  (void)state;
  pags_driving_points start = make(1, 1);
  const pags_point_set *walker = &start.objects[STUB_WALKER];
  int64_t yellow = 0;
  assert_true(walker->count > 100);
  for (int64_t i = 0; i < walker->count; i++)
    yellow += is_colour(walker->rgb + 3 * i, stub_colours[STUB_WALKER]);
  assert_true((double)yellow > 0.8 * (double)walker->count);
  assert_int_equal(start.objects[STUB_BEHIND].count, 0);
  pags_driving_points_destroy(&start);
}

static void far_points_continue_the_wall(void **state) {
  (void)state;
  pags_driving_points start = make(1, 1);
  const pags_point_set *b = &start.background;
  int64_t count = b->count - start.lidar_points, near_wall = 0;
  assert_true(count > 1000);
  for (int64_t i = start.lidar_points; i < b->count; i++) {
    near_wall += fabsf(b->xyz[3 * i] - 30) < 1.5f && b->xyz[3 * i + 2] > 3;
    assert_false(is_colour(b->rgb + 3 * i, stub_sky));
    assert_int_equal(b->object[i], -1);
  }
  assert_true((double)near_wall > 0.4 * (double)count);
  pags_driving_points_destroy(&start);
}

static void held_out_data_is_not_used(void **state) {
  (void)state;
  pags_driving_points start = make(1, 1);
  const pags_point_set *b = &start.background;
  for (int64_t i = 0; i < b->count; i++) {
    const uint8_t *c = b->rgb + 3 * i;
    /* No point is magenta, the colour of the held-out photograph. */
    assert_false(c[0] > c[1] + 60 && c[2] > c[1] + 60);
  }
  for (int64_t i = 0; i < start.lidar_points; i++)
    assert_true(b->xyz[3 * i + 2] < 4.9f || b->xyz[3 * i] > 29);
  pags_driving_points_destroy(&start);
}

static void without_lidar_points_are_matched(void **state) {
  (void)state;
  pags_driving_points start = make(0, 1);
  const pags_point_set *b = &start.background;
  int64_t matched = 0;
  assert_int_equal(start.lidar_points, 0);
  for (int64_t i = 0; i < b->count; i++) {
    /* Points matched in the lane of a moving car are left out. */
    assert_false(is_colour(b->rgb + 3 * i, stub_magenta));
    matched += is_colour(b->rgb + 3 * i, stub_wall);
  }
  assert_true(matched > 1000);
  assert_true(start.objects[STUB_CAR].count > 100);
  pags_driving_points_destroy(&start);
}

static void same(const pags_point_set *a, const pags_point_set *b) {
  assert_int_equal(a->count, b->count);
  if (!a->count)
    return;
  assert_memory_equal(a->xyz, b->xyz, (size_t)a->count * 3 * sizeof *a->xyz);
  assert_memory_equal(a->rgb, b->rgb, (size_t)a->count * 3);
}

static void threads_change_nothing(void **state) {
  (void)state;
  pags_driving_points one = make(1, 1), three = make(1, 3);
  same(&one.background, &three.background);
  for (int i = 0; i < STUB_OBJECTS; i++)
    same(&one.objects[i], &three.objects[i]);
  pags_driving_points_destroy(&one);
  pags_driving_points_destroy(&three);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(background_lies_on_its_surfaces),
      cmocka_unit_test(fewer_lidar_points_are_means_of_larger_voxels),
      cmocka_unit_test(moving_objects_have_separate_points),
      cmocka_unit_test(objects_without_lidar_are_filled_if_visible),
      cmocka_unit_test(far_points_continue_the_wall),
      cmocka_unit_test(held_out_data_is_not_used),
      cmocka_unit_test(without_lidar_points_are_matched),
      cmocka_unit_test(threads_change_nothing),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
