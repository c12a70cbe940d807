/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the cache of photographs: its pictures, its size limit, errors of background decodes, and any number of
 * threads. */
#include <pags/dataset.h>

#include "dataset/internal.h"
#include "unit/scratch.h"

enum { VIEWS = 12, WIDTH = 52, HEIGHT = 40 };

static int painted; /* index of the picture that is being painted */

static uint8_t paint(int x, int y, int c) {
  return (uint8_t)(x * 3 + y * 5 + c * 40 + painted * 17);
}

typedef struct fixture {
  scratch scratch;
  pags_dataset *dataset;
} fixture;

/* Writes a data set of twelve pictures, the third with a mask whose pixel (20, 10) is black. */
static int begin(void **state) {
  static fixture f;
  char text[8192] = "{\"fl_x\": 50, \"frames\": [", name[32];
  scratch_begin(&f.scratch);
  for (int i = 0; i < VIEWS; i++) {
    size_t end = strlen(text);
    snprintf(name, sizeof name, "%02d.png", i);
    painted = i;
    scratch_picture(&f.scratch, name, WIDTH, HEIGHT, paint);
    snprintf(text + end, sizeof text - end,
             "%s{\"file_path\": \"%s\", %s\"transform_matrix\": [[1,0,0,%d],[0,1,0,0],[0,0,1,0]]}", i ? "," : "", name,
             i == 2 ? "\"mask_path\": \"mask.png\"," : "", i);
  }
  snprintf(text + strlen(text), sizeof text - strlen(text), "]}");
  scratch_text(&f.scratch, "transforms.json", text);
  pags_image mask;
  scratch_ok(pags_image_create(&mask, WIDTH, HEIGHT, 1, PAGS_U8));
  memset(mask.data, 255, WIDTH * HEIGHT);
  ((uint8_t *)mask.data)[10 * WIDTH + 20] = 0;
  scratch_ok(pags_image_save(scratch_path(&f.scratch, "mask.png"), &mask));
  pags_image_destroy(&mask);
  scratch_ok(pags_dataset_open(f.scratch.folder, NULL, &f.dataset));
  *state = &f;
  return 0;
}

static int end(void **state) {
  fixture *f = *state;
  pags_dataset_close(f->dataset);
  scratch_end(&f->scratch);
  return 0;
}

static void check_budget(const pags_photo_cache *cache, uint64_t budget) {
  uint64_t used, peak, decoded;
  pags_photo_cache_figures(cache, &used, &peak, &decoded);
  assert_true(used <= peak);
  if (peak > budget)
    fail_msg("%llu bytes of %llu", (unsigned long long)peak, (unsigned long long)budget);
}

/* Compares all samples of a photograph with its painted values averaged over squares of `shrink` pixels. */
static void check_photo(int64_t view, int shrink, const pags_photo *photo) {
  assert_true(photo->width == WIDTH / shrink && photo->height == HEIGHT / shrink);
  assert_int_equal(photo->stride, (photo->width + 15) / 16 * 16);
  painted = (int)view;
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < photo->height; y++)
      for (int x = 0; x < photo->stride; x++) {
        int sum = 0;
        for (int i = 0; i < shrink * shrink && x < photo->width; i++)
          sum += paint(x * shrink + i % shrink, y * shrink + i / shrink, c);
        int expected = (2 * sum + shrink * shrink) / (2 * shrink * shrink);
        assert_int_equal(photo->rgb[(c * photo->height + y) * photo->stride + x], expected);
      }
  assert_true((photo->mask != NULL) == (view == 2));
  for (int y = 0; photo->mask && y < photo->height; y++)
    for (int x = 0; x < photo->stride; x++) {
      int used = x < photo->width && !(x == 20 / shrink && y == 10 / shrink);
      assert_int_equal(photo->mask[y * photo->stride + x], used ? 255 : 0);
    }
}

static void check_get(pags_photo_cache *cache, int64_t view, int shrink) {
  pags_photo photo;
  scratch_ok(pags_photo_cache_get(cache, view, shrink, &photo));
  check_photo(view, shrink, &photo);
}

static uint64_t decoded_by(const pags_photo_cache *cache) {
  uint64_t used, peak, decoded;
  pags_photo_cache_figures(cache, &used, &peak, &decoded);
  return decoded;
}

static const uint64_t plenty = UINT64_C(1) << 30;
/* The smallest size limit: three photographs of four planes, rows padded to 64 bytes. */
static const uint64_t smallest = 3 * (4 * 64 * HEIGHT + 64);

static void test_contents(void **state) {
  fixture *f = *state;
  pags_tasks *tasks = pags_tasks_create(2);
  pags_photo_cache *cache;
  scratch_ok(pags_photo_cache_create(f->dataset, tasks, plenty, &cache));
  for (int shrink = 4; shrink >= 1; shrink /= 2)
    for (int64_t i = 0; i < VIEWS; i++)
      check_get(cache, i, shrink);
  assert_int_equal(decoded_by(cache), 3 * VIEWS);
  for (int64_t i = VIEWS; i-- > 0;)
    check_get(cache, i, 1);
  assert_int_equal(decoded_by(cache), 3 * VIEWS); /* all were still in the cache */
  check_get(cache, 3, 2);
  assert_int_equal(decoded_by(cache), 3 * VIEWS + 1);
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
}

/* Requests photographs in a trainer's orders, with size limits from small to large, and with one thread and several. */
static void test_budget(void **state) {
  fixture *f = *state;
  for (int threads = 1; threads <= 4; threads++)
    for (int room = 0; room < 4; room++) {
      uint64_t budget = smallest + (uint64_t)room * 14000;
      pags_tasks *tasks = pags_tasks_create(threads);
      pags_photo_cache *cache;
      scratch_ok(pags_photo_cache_create(f->dataset, tasks, budget, &cache));
      for (int pass = 0; pass < 6; pass++) {
        int64_t order[VIEWS];
        int shrink = pass < 2 ? 4 : pass < 4 ? 2 : 1;
        for (int64_t i = 0; i < VIEWS; i++)
          order[i] = (i * 5 + pass) % VIEWS;
        pags_photo_cache_prefetch(cache, order, VIEWS, shrink);
        for (int64_t i = 0; i < VIEWS; i++) {
          check_get(cache, order[i], shrink);
          check_budget(cache, budget);
          if (i == 5) /* a photograph out of order, as previews need */
            check_get(cache, 7, 1);
        }
      }
      check_budget(cache, budget);
      pags_photo_cache_destroy(cache);
      pags_tasks_destroy(tasks);
    }
}

/* With room for all photographs an announced pass decodes each photograph once, and a second pass none. */
static void test_prefetch_is_used(void **state) {
  fixture *f = *state;
  for (int threads = 1; threads <= 3; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    pags_photo_cache *cache;
    scratch_ok(pags_photo_cache_create(f->dataset, tasks, plenty, &cache));
    for (int pass = 0; pass < 2; pass++) {
      int64_t order[VIEWS + 2] = {0, 0};
      for (int64_t i = 0; i < VIEWS; i++)
        order[i + 2] = VIEWS - 1 - i; /* the order has view 0 three times */
      pags_photo_cache_prefetch(cache, order, VIEWS + 2, 1);
      for (int i = 0; i < VIEWS + 2; i++)
        check_get(cache, order[i], 1);
      assert_int_equal(decoded_by(cache), VIEWS);
    }
    pags_photo_cache_destroy(cache);
    pags_tasks_destroy(tasks);
  }
}

static void test_failures_surface(void **state) {
  fixture *f = *state;
  pags_photo photo;
  scratch_text(&f->scratch, "04.png", "\x89PNG");
  painted = 5;
  /* The file of a photograph changes after the data set was opened. */
  scratch_picture(&f->scratch, "05.png", WIDTH + 1, HEIGHT, paint);
  for (int threads = 1; threads <= 2; threads++) {
    pags_tasks *tasks = pags_tasks_create(threads);
    pags_photo_cache *cache;
    scratch_ok(pags_photo_cache_create(f->dataset, tasks, plenty, &cache));
    const int64_t order[] = {3, 4, 5, 6};
    pags_photo_cache_prefetch(cache, order, 4, 1);
    check_get(cache, 3, 1);
    scratch_expect(pags_photo_cache_get(cache, 4, 1, &photo), PAGS_ERROR_FORMAT, "04.png");
    scratch_expect(pags_photo_cache_get(cache, 4, 1, &photo), PAGS_ERROR_FORMAT, "04.png");
    scratch_expect(pags_photo_cache_get(cache, 5, 1, &photo), PAGS_ERROR_FORMAT, "53 x 40 pixels, expected 52 x 40");
    check_get(cache, 6, 1);
    pags_photo_cache_destroy(cache);
    pags_tasks_destroy(tasks);
  }
  painted = 4; /* after the file is repaired, the next get decodes it again */
  scratch_picture(&f->scratch, "04.png", WIDTH, HEIGHT, paint);
  painted = 5;
  scratch_picture(&f->scratch, "05.png", WIDTH, HEIGHT, paint);
}

static void test_destroy_with_work_under_way(void **state) {
  fixture *f = *state;
  for (int i = 0; i < 20; i++) {
    pags_tasks *tasks = pags_tasks_create(1 + i % 4);
    pags_photo_cache *cache;
    int64_t order[VIEWS];
    for (int64_t j = 0; j < VIEWS; j++)
      order[j] = j;
    scratch_ok(pags_photo_cache_create(f->dataset, tasks, plenty, &cache));
    pags_photo_cache_prefetch(cache, order, VIEWS, 1);
    pags_photo_cache_prefetch(cache, order, 0, 1);
    pags_photo_cache_destroy(cache);
    pags_tasks_destroy(tasks);
  }
  pags_photo_cache_destroy(NULL);
}

/* Where the shrink factors don't divide the picture's size, pixels and intrinsics still agree: a vertical edge at x =
 * 20 of the picture must appear at x = 20 * fx' / fx of the small one. */
static uint8_t edge(int x, int y, int c) {
  (void)y, (void)c;
  return x < 20 ? 0 : 250;
}

static void test_odd_factors(void **state) {
  (void)state;
  scratch s;
  scratch_begin(&s);
  scratch_picture(&s, "a.png", 53, 41, edge);
  scratch_text(&s, "transforms.json",
               "{\"fl_x\": 50, \"frames\": [{\"file_path\": \"a.png\", "
               "\"transform_matrix\": [[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]}");
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  options.downscale = 1.7;
  pags_dataset *dataset;
  scratch_ok(pags_dataset_open(s.folder, &options, &dataset));
  pags_tasks *tasks = pags_tasks_create(1);
  pags_photo_cache *cache;
  pags_photo photo;
  scratch_ok(pags_photo_cache_create(dataset, tasks, plenty, &cache));
  for (int shrink = 1; shrink <= 4; shrink *= 2) {
    pags_camera camera = pags_camera_downscale(&pags_dataset_view(dataset, 0)->camera, shrink);
    scratch_ok(pags_photo_cache_get(cache, 0, shrink, &photo));
    assert_true(photo.width == camera.width && photo.height == camera.height);
    double dark = 0; /* width of the dark part left of the edge, in pixels of the small picture */
    for (int x = 0; x < photo.width; x++)
      dark += 1 - photo.rgb[x] / 250.0;
    double expected = 20 * camera.fx / 50;
    assert_true(dark > expected - 0.01 && dark < expected + 0.01);
  }
  pags_photo_cache_destroy(cache);
  pags_tasks_destroy(tasks);
  pags_dataset_close(dataset);
  scratch_end(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_contents),         cmocka_unit_test(test_budget),
      cmocka_unit_test(test_prefetch_is_used), cmocka_unit_test(test_failures_surface),
      cmocka_unit_test(test_odd_factors),      cmocka_unit_test(test_destroy_with_work_under_way),
  };
  return cmocka_run_group_tests(tests, begin, end);
}
