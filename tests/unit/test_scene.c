/* Scene folders and bare files as scenes. */
#include "pags/scene.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include "base/text.h"
#include "scratch_folder.h"
#include "splat_files.h"

#include <cmocka.h>

/* Two models, two views, all fields off their defaults. */
static pags_scene sample(void) {
  pags_scene scene = {.origin = {500000.125, -0.1, 1e-300},
                      .up = PAGS_UP_Z,
                      .antialiased = 1,
                      .background = {0.1f, 0.5f, 1},
                      .time_begin = 0.1,
                      .time_end = 8.25,
                      .seed = UINT64_MAX,
                      .iterations = 7000,
                      .model_count = 2,
                      .view_count = 2};
  scene.dataset = pags_text_copy("/data/a \"quoted\" place");
  scene.config = pags_text_copy("\n{\n  \"rate\": 0.00016\n}\n\n");
  scene.models = calloc(2, sizeof *scene.models);
  scene.views = calloc(2, sizeof *scene.views);
  for (int i = 0; i < 2; ++i) {
    scene.models[i].name = pags_text_copy(i ? "car 1" : "background");
    scene.models[i].file = pags_text_copy(i ? "objects/car 1.ply" : "background.ply");
    sample_gaussians(&scene.models[i].gaussians, 40 + i, i ? 1 : 3, (uint64_t)i);
    scene.views[i].name = pags_text_copy(i ? "b.png" : "a.png");
    scene.views[i].test = i == 0;
    scene.views[i].camera =
        (pags_camera){64, 48, 50.5, 51, 32, 24, {1, 0, 0, 3, 0, 1, 0, 4, 0, 0, 1, 5}, i ? 2 : (double)NAN};
  }
  return scene;
}

static void assert_text(const char *a, const char *b) {
  assert_non_null(a);
  assert_string_equal(a, b);
}

static void a_scene_comes_back(void **state) {
  (void)state;
  pags_scene scene = sample(), back;
  assert_int_equal(pags_scene_save(scratch("s"), &scene), PAGS_OK);
  if (pags_scene_load(scratch("s"), &back) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_memory_equal(back.origin, scene.origin, sizeof scene.origin);
  assert_memory_equal(back.background, scene.background, sizeof scene.background);
  assert_int_equal(back.up, PAGS_UP_Z);
  assert_int_equal(back.antialiased, 1);
  assert_true(back.time_begin == 0.1 && back.time_end == 8.25);
  assert_true(back.seed == UINT64_MAX);
  assert_int_equal(back.iterations, 7000);
  assert_text(back.dataset, scene.dataset);
  assert_text(back.config, "{\n  \"rate\": 0.00016\n}");
  assert_int_equal(back.model_count, 2);
  assert_text(back.models[1].name, "car 1");
  assert_text(back.models[1].file, "objects/car 1.ply");
  assert_int_equal(pags_scene_gaussian_count(&back), 81);
  for (int i = 0; i < 2; ++i)
    for (int p = 0; p < pags_plane_count(scene.models[i].gaussians.sh_degree); ++p)
      assert_memory_equal(pags_plane(&back.models[i].gaussians, p), pags_plane(&scene.models[i].gaussians, p),
                          (size_t)scene.models[i].gaussians.count * sizeof(float));
  assert_int_equal(back.view_count, 2);
  assert_text(back.views[0].name, "a.png");
  assert_int_equal(back.views[0].test, 1);
  assert_int_equal(back.views[1].test, 0);
  assert_true(isnan(back.views[0].camera.time) && back.views[1].camera.time == 2);
  assert_memory_equal(back.views[1].camera.world_from_camera, scene.views[1].camera.world_from_camera, 12 * 8);
  pags_scene_destroy(&scene);
  pags_scene_destroy(&back);
  assert_int_equal(back.model_count, 0);
}

static void assert_same_file(const char *a, const char *b) {
  uint8_t *bytes[2];
  size_t sizes[2];
  assert_int_equal(pags_file_read(scratch(a), &bytes[0], &sizes[0]), PAGS_OK);
  assert_int_equal(pags_file_read(scratch(b), &bytes[1], &sizes[1]), PAGS_OK);
  assert_int_equal(sizes[0], sizes[1]);
  assert_memory_equal(bytes[0], bytes[1], sizes[0]);
  free(bytes[0]);
  free(bytes[1]);
}

static void saving_is_the_same_to_the_byte(void **state) {
  (void)state;
  pags_scene scene = sample(), back;
  assert_int_equal(pags_scene_save(scratch("one"), &scene), PAGS_OK);
  assert_int_equal(pags_scene_load(scratch("one/scene.json"), &back), PAGS_OK);
  assert_int_equal(pags_scene_save(scratch("two"), &back), PAGS_OK);
  assert_same_file("one/scene.json", "two/scene.json");
  assert_same_file("one/background.ply", "two/background.ply");
  assert_same_file("one/objects/car 1.ply", "two/objects/car 1.ply");
  pags_scene_destroy(&scene);
  pags_scene_destroy(&back);
}

static void a_bare_file_is_a_scene(void **state) {
  (void)state;
  file_bytes file = make_splat(30, 1);
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch_file("bare.splat", file.data, file.size), &scene), PAGS_OK);
  assert_int_equal(scene.model_count, 1);
  assert_text(scene.models[0].name, "background");
  assert_int_equal(scene.up, PAGS_UP_MINUS_Y);
  assert_int_equal(scene.view_count, 0);
  assert_null(scene.dataset);
  assert_int_equal(pags_scene_save(scratch("from_bare"), &scene), PAGS_OK);
  pags_scene_destroy(&scene);
  assert_int_equal(pags_scene_load(scratch("from_bare"), &scene), PAGS_OK);
  assert_int_equal(pags_scene_gaussian_count(&scene), 30);
  pags_scene_destroy(&scene);
  bytes_free(&file);
}

/* Saves the sample, replaces `from` in scene.json by `to` (of the same length or shorter, padded) and loads it. */
static void assert_edit_fails(const char *from, const char *to, pags_result code, const char *message) {
  pags_scene scene = sample(), back;
  uint8_t *bytes;
  size_t size;
  assert_int_equal(pags_scene_save(scratch("e"), &scene), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("e/scene.json"), &bytes, &size), PAGS_OK);
  char *at = strstr((char *)bytes, from);
  assert_non_null(at);
  assert_true(strlen(to) <= strlen(from));
  memset(at, ' ', strlen(from));
  memcpy(at, to, strlen(to));
  scratch_file("e/scene.json", bytes, size);
  free(bytes);
  assert_int_equal(pags_scene_load(scratch("e"), &back), code);
  if (!strstr(pags_error_message(), message))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
  assert_null(back.models);
  pags_scene_destroy(&scene);
}

static void bad_scenes_are_explained(void **state) {
  (void)state;
  assert_edit_fails("\"version\": 1,", "\"version\":99,", PAGS_ERROR_UNSUPPORTED,
                    "scene.json:2: the scene's version is 99, this program reads up to 1");
  assert_edit_fails("\"version\": 1,", "", PAGS_ERROR_FORMAT, "expected a number for 'version', which is missing");
  assert_edit_fails("metres", "feet", PAGS_ERROR_FORMAT, "expected \"metres\" for 'units'");
  assert_edit_fails("\"z\"", "\"x\"", PAGS_ERROR_FORMAT, "expected \"z\", \"-y\" or \"unknown\" for 'up'");
}

static void files_outside_are_refused(void **state) {
  (void)state;
  assert_edit_fails("objects/car 1.ply", "../../carss/1.ply", PAGS_ERROR_FORMAT,
                    "expected a 'file' inside of the scene's folder, found \"../../carss/1.ply\"");
  assert_edit_fails("objects/car 1.ply", "/bjects/car-1.ply", PAGS_ERROR_FORMAT, "inside of the scene's folder");
}

static void models_must_match_what_is_promised(void **state) {
  (void)state;
  assert_edit_fails("\"gaussians\": 41", "\"gaussians\": 42", PAGS_ERROR_FORMAT,
                    "scene.json promises 42 Gaussians of SH degree 1, found 41 of degree 1");
  assert_edit_fails("background.ply", "backgroumd.ply", PAGS_ERROR_IO, "backgroumd.ply: can't open");
}

static void other_paths_are_explained(void **state) {
  (void)state;
  pags_scene scene;
  assert_int_equal(pags_make_dirs(scratch("empty")), PAGS_OK);
  assert_int_equal(pags_scene_load(scratch("empty"), &scene), PAGS_ERROR_IO);
  assert_non_null(strstr(pags_error_message(), "empty: expected a scene, but the folder has no scene.json"));
  assert_int_equal(pags_scene_load(scratch("absent"), &scene), PAGS_ERROR_IO);
  assert_int_equal(pags_scene_load(scratch_file("a.png", "\x89PNG", 4), &scene), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "a.png: expected a splat file"));
  scene = sample();
  assert_int_equal(pags_scene_save(scratch("a.png"), &scene), PAGS_ERROR_IO);
  pags_scene_destroy(&scene);
}

static int setup(void **state) {
  (void)state;
  return scratch_make();
}

static int teardown(void **state) {
  (void)state;
  return scratch_remove();
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_scene_comes_back),        cmocka_unit_test(saving_is_the_same_to_the_byte),
      cmocka_unit_test(a_bare_file_is_a_scene),    cmocka_unit_test(bad_scenes_are_explained),
      cmocka_unit_test(files_outside_are_refused), cmocka_unit_test(models_must_match_what_is_promised),
      cmocka_unit_test(other_paths_are_explained),
  };
  return cmocka_run_group_tests(tests, setup, teardown);
}
