/* SPDX-License-Identifier: Apache-2.0 */
/* Tests pags_synth_town: number, position and size of Gaussians, and the same bytes for any number of threads. */
#include <math.h>
#include <pags/scene.h>
#include <pags/synth.h>

#include "base/sort.h"
#include "synth/size_tables.h"
#include "unit/scratch.h"

static scratch place;

enum { COUNT = 6000 };

static pags_town_options small_town(void) {
  pags_town_options options = pags_town_options_default();
  options.gaussians = COUNT;
  options.frames = 3;
  options.seed = 7;
  return options;
}

static char *make(const char *name, const pags_town_options *options, int threads, pags_town_facts *facts) {
  char *folder = pags_path_join(place.folder, name);
  pags_tasks *tasks = pags_tasks_create(threads);
  assert_non_null(tasks);
  scratch_ok(pags_synth_town(folder, options, tasks, NULL, NULL, facts));
  pags_tasks_destroy(tasks);
  return folder;
}

static void same_file(const char *a, const char *b, const char *name) {
  char *paths[2] = {pags_path_join(a, name), pags_path_join(b, name)};
  uint8_t *bytes[2];
  size_t size[2];
  for (int i = 0; i < 2; i++)
    assert_int_equal(pags_file_read(paths[i], &bytes[i], &size[i]), PAGS_OK);
  assert_int_equal(size[0], size[1]);
  assert_memory_equal(bytes[0], bytes[1], size[0]);
  for (int i = 0; i < 2; i++) {
    free(bytes[i]);
    free(paths[i]);
  }
}

static void test_same_bytes(void **state) {
  (void)state;
  const pags_town_options options = small_town();
  char *one = make("one", &options, 1, NULL), *two = make("two", &options, 2, NULL);
  same_file(one, two, "background.ply");
  same_file(one, two, "scene.json");
  same_file(one, two, "sky.npz");
  free(one);
  free(two);
}

static void load(const char *folder, pags_scene *scene) {
  assert_int_equal(pags_scene_load(folder, scene), PAGS_OK);
  assert_int_equal(scene->model_count, 1);
}

static void test_scene(void **state) {
  (void)state;
  pags_town_options options = small_town();
  pags_town_facts facts;
  pags_scene scene;
  options.density = 1.5;
  char *folder = make("scene", &options, 2, &facts);
  load(folder, &scene);
  const pags_gaussians *g = &scene.models[0].gaussians;
  assert_int_equal(g->count, COUNT * 3 / 2);
  assert_int_equal(facts.gaussians, g->count);
  assert_int_equal(g->sh_degree, 1);
  assert_int_equal(scene.up, PAGS_UP_Z);
  assert_int_equal(scene.view_count, 9);
  assert_true(scene.sky.size > 0);
  int critical = 0, low = 0;
  for (int64_t i = 0; i < g->count; i++) {
    const float x = pags_plane(g, PAGS_MEAN)[i], y = pags_plane(g, PAGS_MEAN + 1)[i],
                z = pags_plane(g, PAGS_MEAN + 2)[i];
    assert_true(x > -25.0f && x < (float)facts.length + 25.0f && fabsf(y) < (float)facts.breadth + 20.0f);
    assert_true(z > -0.5f && z < 30.0f);
    assert_true(g->s_sem[i] == 0.0f || g->s_sem[i] == 1.0f);
    critical += g->s_sem[i] > 0.5f;
    assert_false(g->s_sem[i] > 0.5f && z > 2.5f); /* no car or person is that high */
    low += z < 0.5f;
  }
  assert_true(critical > COUNT / 200 && critical < COUNT / 3);
  assert_true(low > COUNT / 5);
  pags_scene_destroy(&scene);
  free(folder);
}

/* A block of houses has no Gaussians inside, 4 m behind the fronts and 3 m from its ends, as no street sees that
 * space. */
static void test_hidden_is_empty(void **state) {
  (void)state;
  const pags_town_options options = small_town();
  pags_scene scene;
  char *folder = make("hidden", &options, 2, NULL);
  load(folder, &scene);
  const pags_gaussians *g = &scene.models[0].gaussians;
  int inside = 0;
  for (int64_t i = 0; i < g->count; i++) {
    const float x = pags_plane(g, PAGS_MEAN)[i], y = pags_plane(g, PAGS_MEAN + 1)[i],
                z = pags_plane(g, PAGS_MEAN + 2)[i];
    inside += y > 9.2f + 4.0f && y < 9.2f + 22.0f - 4.0f && x > 3.0f && x < 9.0f && z < 5.0f;
  }
  assert_int_equal(inside, 0);
  pags_scene_destroy(&scene);
  free(folder);
}

/* On roads no size is clipped: the quantiles of sizes and opacities are those of the generator's table within four
 * standard errors (bounded by a tenth here). */
static void test_histograms(void **state) {
  (void)state;
  pags_town_options options = small_town();
  pags_scene scene;
  options.density = 4.0;
  char *folder = make("sizes", &options, 2, NULL);
  load(folder, &scene);
  const pags_gaussians *g = &scene.models[0].gaussians;
  float *longest = malloc((size_t)g->count * sizeof *longest), *logit = malloc((size_t)g->count * sizeof *logit);
  int count = 0;
  for (int64_t i = 0; i < g->count; i++)
    if (fabsf(pags_plane(g, PAGS_MEAN + 2)[i]) < 0.1f && fabsf(pags_plane(g, PAGS_MEAN + 1)[i]) < 5.0f) {
      longest[count] = pags_plane(g, PAGS_SCALE)[i];
      logit[count++] = pags_plane(g, PAGS_OPACITY)[i];
    }
  assert_true(count > 800);
  pags_sort_floats(longest, count);
  pags_sort_floats(logit, count);
  for (int q = 2; q < 7; q++) { /* the quantiles from 15 to 85 per cent */
    const int at = (int)(pags_quantile_shares[q] * (float)count);
    assert_true(fabsf(longest[at] - pags_size_ground.ln_long[q]) < 0.1f);
    assert_true(fabsf(logit[at] - pags_size_ground.logit_opacity[q]) < 0.25f);
  }
  free(longest);
  free(logit);
  pags_scene_destroy(&scene);
  free(folder);
}

static void test_options(void **state) {
  (void)state;
  pags_town_options options = small_town();
  const char *folder = scratch_path(&place, "bad");
  pags_tasks *tasks = pags_tasks_create(1);
  options.density = 100;
  scratch_expect(pags_synth_town(folder, &options, tasks, NULL, NULL, NULL), PAGS_ERROR_ARGUMENT, "density is 100");
  options = small_town();
  options.gaussians = 3;
  scratch_expect(pags_synth_town(folder, &options, tasks, NULL, NULL, NULL), PAGS_ERROR_ARGUMENT, "gaussians is 3");
  pags_tasks_destroy(tasks);
}

static int setup(void **state) {
  (void)state;
  scratch_begin(&place);
  return 0;
}

static int teardown(void **state) {
  (void)state;
  scratch_end(&place);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_same_bytes), cmocka_unit_test(test_scene),
                                     cmocka_unit_test(test_hidden_is_empty), cmocka_unit_test(test_histograms),
                                     cmocka_unit_test(test_options)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
