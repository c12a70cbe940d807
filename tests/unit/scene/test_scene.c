/* SPDX-License-Identifier: Apache-2.0 */
/* Tests scene folders, and splat files opened as scenes. */
#include <pags/scene.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include "base/rng.h"
#include "base/text.h"
#include "same_file.h"
#include "scratch_folder.h"
#include "splat_files.h"

#include <cmocka.h>

/* A scene of two models and two views in which no field has its default value. */
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
  for (int i = 0; i < 2; i++) {
    scene.models[i].name = pags_text_copy(i ? "car 1" : "background");
    scene.models[i].file = pags_text_copy(i ? "objects/car 1.ply" : "background.ply");
    sample_gaussians(&scene.models[i].gaussians, 40 + i, i ? 1 : 3, (uint64_t)i);
    scene.models[i].gaussians.alpha_min = i ? 0.0f : 0.02f;
    scene.views[i].name = pags_text_copy(i ? "b.png" : "a.png");
    scene.views[i].test = i == 0;
    scene.views[i].camera = (pags_camera){
        64, 48, 50.5, 51, 32, 24, {1, 0, 0, 3, 0, 1, 0, 4, 0, 0, 1, 5}, i ? 2 : (double)NAN, {0, 0, {0}}, {0}};
  }
  return scene;
}

/* The sample extended to a driving scene: a sky, a parked object and a moving object. */
static pags_scene driving_sample(void) {
  pags_scene scene = sample();
  scene.fps = 10;
  scene.place = (pags_place){-33.25, 151.125, 20, 1};
  scene.notes = pags_text_copy("{\"fourier\": []}");
  scene.object_count = 2;
  scene.objects = calloc(2, sizeof *scene.objects);
  for (int i = 0; i < 2; i++) {
    pags_scene_object *object = &scene.objects[i];
    object->record = (pags_object){.id = pags_text_copy(i ? "a/b\"c" : "parked"),
                                   .class_name = pags_text_copy(i ? "Car" : "Pedestrian with Object"),
                                   .category = i ? PAGS_CATEGORY_VEHICLE : PAGS_CATEGORY_PEDESTRIAN,
                                   .size = {4.5, 1.9, 1.0 / 3},
                                   .moving = i,
                                   .keyframe_count = 2,
                                   .keyframes = calloc(2, sizeof *object->record.keyframes)};
    object->model = i ? 1 : -1;
    object->critical = i;
    object->rigid = !i;
    for (int k = 0; k < 2; k++)
      object->record.keyframes[k] =
          (pags_keyframe){.frame = k + 3,
                          .trained = k,
                          .time = 0.1 + 0.1 * k,
                          .world_from_object = {0, -1, 0, 500000.1, 1, 0, 0, 2.0 / 3, 0, 0, 1, k},
                          .rotation = {1e-3, 0, -0.1},
                          .translation = {0.1 * k, 1.0 / 7, 0}};
  }
  for (int i = 0; i < 2; i++) {
    scene.views[i].sensor = i ? 2 : -1;
    scene.views[i].frame = i ? 12 : -1;
    for (int c = 0; c < 3; c++) {
      scene.views[i].gain[c] = i ? 1 + 0.01 * c : 1;
      scene.views[i].offset[c] = i ? 0.1 : 0;
    }
  }
  pags_gaussians *background = &scene.models[0].gaussians;
  assert_int_equal(pags_gaussians_add_object_id(background), PAGS_OK);
  background->object_id[3] = 0;
  background->object_id[4] = 1;
  assert_int_equal(pags_gaussians_add_fourier(&scene.models[1].gaussians, 0), PAGS_OK);
  assert_int_equal(pags_sky_create(&scene.sky, 3), PAGS_OK);
  for (int i = 0; i < 6 * 9 * 3; i++)
    scene.sky.texels[i] = (float)i / 128;
  return scene;
}

static void assert_text(const char *a, const char *b) {
  assert_non_null(a);
  assert_string_equal(a, b);
}

static void a_scene_round_trips(void **state) {
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
  for (int i = 0; i < 2; i++)
    for (int p = 0; p < pags_plane_count(scene.models[i].gaussians.sh_degree); p++)
      assert_memory_equal(pags_plane(&back.models[i].gaussians, p), pags_plane(&scene.models[i].gaussians, p),
                          (size_t)scene.models[i].gaussians.count * sizeof(float));
  assert_true(back.models[0].gaussians.alpha_min == 0.02f && back.models[1].gaussians.alpha_min == 0.0f);
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

static void saving_is_the_same_to_the_byte(void **state) {
  (void)state;
  pags_scene scene = sample(), back;
  assert_int_equal(pags_scene_save(scratch("one"), &scene), PAGS_OK);
  assert_int_equal(pags_scene_load(scratch("one/scene.json"), &back), PAGS_OK);
  assert_int_equal(pags_scene_save(scratch("two"), &back), PAGS_OK);
  assert_same_file(scratch("one/scene.json"), scratch("two/scene.json"));
  assert_same_file(scratch("one/background.ply"), scratch("two/background.ply"));
  assert_same_file(scratch("one/objects/car 1.ply"), scratch("two/objects/car 1.ply"));
  pags_scene_destroy(&scene);
  pags_scene_destroy(&back);
}

static void a_driving_scene_round_trips(void **state) {
  (void)state;
  pags_scene scene = driving_sample(), back;
  assert_int_equal(pags_scene_save(scratch("d"), &scene), PAGS_OK);
  if (pags_scene_load(scratch("d"), &back) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_true(back.fps == 10);
  assert_true(back.place.known && back.place.latitude == -33.25 && back.place.longitude == 151.125 &&
              back.place.altitude == 20);
  assert_text(back.notes, scene.notes);
  assert_int_equal(back.object_count, 2);
  for (int i = 0; i < 2; i++) {
    const pags_scene_object *a = &scene.objects[i], *b = &back.objects[i];
    assert_text(b->record.id, a->record.id);
    assert_text(b->record.class_name, a->record.class_name);
    assert_int_equal(b->record.category, a->record.category);
    assert_memory_equal(b->record.size, a->record.size, sizeof a->record.size);
    assert_int_equal(b->record.moving, a->record.moving);
    assert_int_equal(b->model, a->model);
    assert_int_equal(b->critical, a->critical);
    assert_int_equal(b->rigid, a->rigid);
    assert_int_equal(b->record.keyframe_count, 2);
    assert_memory_equal(b->record.keyframes, a->record.keyframes, 2 * sizeof *a->record.keyframes);
    assert_int_equal(back.views[i].sensor, scene.views[i].sensor);
    assert_int_equal(back.views[i].frame, scene.views[i].frame);
    assert_memory_equal(back.views[i].gain, scene.views[i].gain, 3 * sizeof(double));
    assert_memory_equal(back.views[i].offset, scene.views[i].offset, 3 * sizeof(double));
  }
  assert_int_equal(back.sky.size, 3);
  assert_memory_equal(back.sky.texels, scene.sky.texels, 6 * 9 * 3 * sizeof(float));
  assert_int_equal(back.models[0].gaussians.object_id[4], 1);
  assert_non_null(back.models[1].gaussians.fourier);
  assert_int_equal(pags_scene_save(scratch("d2"), &back), PAGS_OK);
  assert_same_file(scratch("d/scene.json"), scratch("d2/scene.json"));
  assert_same_file(scratch("d/sky.npz"), scratch("d2/sky.npz"));
  assert_same_file(scratch("d/objects/car 1.ply"), scratch("d2/objects/car 1.ply"));
  pags_scene_destroy(&scene);
  pags_scene_destroy(&back);
}

static void file_names_are_made_safe(void **state) {
  (void)state;
  pags_scene scene = sample();
  static const char *const pairs[][2] = {{"car 1", "objects/car_1.ply"},
                                         {"../x", "objects/_._x.ply"},
                                         {"", "objects/_.ply"},
                                         {"3f-A.b", "objects/3f-A.b.ply"}};
  for (int i = 0; i < 4; i++) {
    char *file = pags_scene_model_file(&scene, pairs[i][0]);
    assert_text(file, pairs[i][1]);
    free(file);
  }
  free(scene.models[1].file);
  scene.models[1].file = pags_text_copy("objects/Car_1.ply");
  char *file = pags_scene_model_file(&scene, "car 1");
  assert_text(file, "objects/car_1-2.ply");
  free(file);
  pags_scene_destroy(&scene);
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

/* Saves the scene, replaces `from` in its scene.json by `to` (of the same length, or shorter and padded), and expects
 * loading it to fail. */
static void assert_edit_of_fails(pags_scene scene, const char *from, const char *to, pags_result code,
                                 const char *message) {
  pags_scene back;
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

static void assert_edit_fails(const char *from, const char *to, pags_result code, const char *message) {
  assert_edit_of_fails(sample(), from, to, code, message);
}

static void bad_objects_are_explained(void **state) {
  (void)state;
  static const char *const edits[][3] = {
      {"\"vehicle\"", "\"car\"", "for 'category', found \"car\""},
      {"4.5, 1.9", "4.5, -.9", "scene.json:"},
      {"[4.5, 1.9", "[4.5, 0.0", "expected three positive numbers for 'size'"},
      {"\"time\": 0.2,", "\"time\": 0.1,", "expected a 'time' after the previous one's"},
      {"\"world_from_object\": [0, -1,", "\"world_from_object\": [0, 1,",
       "expected a rotation and a translation for 'world_from_object'"},
      {"\"model\": \"car 1\"", "\"model\": \"car 2\"", "found \"car 2\""},
      {"\"sky.npz\"", "\"../sky\"", "expected a file inside of the scene's folder for 'sky'"},
      {"\"fps\": 10", "\"fps\": -1", "for 'fps', found -1"},
      {"151.125", "-181", "for 'geographic_origin', found -33.25, -181"},
      {"\"sensor\": 2", "\"sensor\": x", "scene.json:"},
  };
  for (size_t i = 0; i < sizeof edits / sizeof *edits; i++)
    assert_edit_of_fails(driving_sample(), edits[i][0], edits[i][1], PAGS_ERROR_FORMAT, edits[i][2]);
  pags_scene scene = driving_sample();
  free(scene.objects[0].record.id);
  scene.objects[0].record.id = pags_text_copy(scene.objects[1].record.id);
  assert_edit_of_fails(scene, "metres", "metres", PAGS_ERROR_FORMAT, "two objects are named \"a/b\"c\"");
  scene = driving_sample();
  scene.models[0].gaussians.object_id[7] = 2;
  assert_edit_of_fails(scene, "metres", "metres", PAGS_ERROR_FORMAT,
                       "background.ply: vertex 7: expected 'object_id' of one of 2 objects, found 2");
}

/* Random changes of bytes give an error or a scene, never a crash. */
static void damaged_scenes_cause_no_crash(void **state) {
  (void)state;
  static const char *const files[] = {"f/scene.json", "f/sky.npz", "f/objects/car 1.ply"};
  int refused = 0;
  for (int kind = 0; kind < 3; kind++) {
    pags_scene scene = driving_sample(), back;
    uint8_t *bytes;
    size_t size;
    assert_int_equal(pags_scene_save(scratch("f"), &scene), PAGS_OK);
    pags_scene_destroy(&scene);
    assert_int_equal(pags_file_read(scratch(files[kind]), &bytes, &size), PAGS_OK);
    for (uint64_t i = 0; i < 150; i++) {
      uint8_t *damaged = malloc(size);
      memcpy(damaged, bytes, size);
      for (uint64_t k = 0; k <= i % 3; k++) {
        size_t at = (size_t)pags_rng_below(1, 8 * i + k, (uint64_t)kind, size);
        damaged[at] = (uint8_t)"0123456789-.e\"[]{},:nt/\xff"[pags_rng_below(2, 8 * i + k, (uint64_t)kind, 24)];
      }
      scratch_file(files[kind], damaged, i % 10 ? size : size - 1 - (size_t)i);
      if (pags_scene_load(scratch("f"), &back) == PAGS_OK)
        pags_scene_destroy(&back);
      else
        refused++;
      assert_null(back.models);
      free(damaged);
    }
    free(bytes);
  }
  assert_true(refused > 50);
}

static void bad_scenes_are_explained(void **state) {
  (void)state;
  assert_edit_fails("\"version\": 1,", "\"version\":99,", PAGS_ERROR_UNSUPPORTED,
                    "scene.json:2: the scene's version is 99, this program reads up to 2");
  assert_edit_fails("\"version\": 1,", "", PAGS_ERROR_FORMAT, "expected a number for 'version', which is missing");
  assert_edit_fails("metres", "feet", PAGS_ERROR_FORMAT, "expected \"metres\" for 'units'");
  assert_edit_fails("\"z\"", "\"x\"", PAGS_ERROR_FORMAT, "expected \"z\", \"-y\", \"y\" or \"unknown\" for 'up'");
}

/* Series of more than the constant coefficient need version 2, which older programs refuse; other scenes keep 1. */
static void series_of_coefficients_are_stated(void **state) {
  (void)state;
  pags_scene scene = driving_sample(), back;
  uint8_t *bytes;
  size_t size;
  pags_gaussians_destroy(&scene.models[1].gaussians);
  sample_gaussians(&scene.models[1].gaussians, 41, 1, 1);
  assert_int_equal(pags_gaussians_add_fourier(&scene.models[1].gaussians, 1), PAGS_OK);
  scene.models[1].gaussians.fourier[47 * scene.models[1].gaussians.stride + 40] = 0.5F;
  assert_int_equal(pags_scene_save(scratch("e"), &scene), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("e/scene.json"), &bytes, &size), PAGS_OK);
  assert_non_null(strstr((char *)bytes, "\"version\": 2,"));
  free(bytes);
  if (pags_scene_load(scratch("e"), &back) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  assert_int_equal(back.models[1].gaussians.fourier_degree, 1);
  assert_true(back.models[1].gaussians.fourier[47 * back.models[1].gaussians.stride + 40] == 0.5F);
  pags_scene_destroy(&back);
  assert_edit_of_fails(scene, "\"fourier_degree\": 1", "\"fourier_degree\": 0", PAGS_ERROR_FORMAT,
                       "car 1.ply: scene.json promises Fourier terms up to SH degree 0, found degree 1");
}

static void files_outside_are_refused(void **state) {
  (void)state;
  assert_edit_fails("objects/car 1.ply", "../../carss/1.ply", PAGS_ERROR_FORMAT,
                    "expected a 'file' inside of the scene's folder, found \"../../carss/1.ply\"");
  assert_edit_fails("objects/car 1.ply", "/bjects/car-1.ply", PAGS_ERROR_FORMAT, "inside of the scene's folder");
}

static void models_must_match_the_description(void **state) {
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

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_scene_round_trips),           cmocka_unit_test(saving_is_the_same_to_the_byte),
      cmocka_unit_test(a_bare_file_is_a_scene),        cmocka_unit_test(bad_scenes_are_explained),
      cmocka_unit_test(files_outside_are_refused),     cmocka_unit_test(models_must_match_the_description),
      cmocka_unit_test(other_paths_are_explained),     cmocka_unit_test(a_driving_scene_round_trips),
      cmocka_unit_test(file_names_are_made_safe),      cmocka_unit_test(bad_objects_are_explained),
      cmocka_unit_test(damaged_scenes_cause_no_crash), cmocka_unit_test(series_of_coefficients_are_stated),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
