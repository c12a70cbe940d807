/* SPDX-License-Identifier: Apache-2.0 */
/* Tests training of a driving scene, a small street with moving cars: the parts of the result, and training without
 * each part. Its bits follow only from data, configuration and seed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pags/scene.h>
#include <pags/train.h>
#include <string.h>

#include "base/file.h"
#include "base/rng.h"
#include "dataset/internal.h"
#include "same_file.h"
#include "small_street.h"
#include "train/config.h"
#include "train/exposure.h"
#include "train/score_pass.h"
#include "train/sky_fit.h"
#include "train/stages.h"
#include "train/views.h"

enum { ITERATIONS = 120 };

static pags_train_config quick(void) {
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = ITERATIONS;
  config.schedule.resolution_floor = 24;
  config.schedule.preset = PAGS_PRESET_PLAIN;
  return config;
}

static pags_train_result train(const pags_train_config *config, const char *name, pags_tasks *with, int64_t every,
                               int resume) {
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.dataset = dataset;
  options.output = scratch(name);
  options.tasks = with;
  options.checkpoint_every = every;
  options.preview_every = 0;
  options.log_every = 1;
  options.resume = resume;
  if (pags_train(config, &options, &result) != PAGS_OK)
    fail_msg("%s", pags_error_message());
  return result;
}

static void assert_same_in(const char *a, const char *b, const char *file) {
  char left[1024], right[1024];
  snprintf(left, sizeof left, "%s/%s", scratch(a), file);
  snprintf(right, sizeof right, "%s/%s", scratch(b), file);
  assert_same_file(left, right);
}

static void assert_same_run(const char *a, const char *b) {
  assert_same_in(a, b, "scene.json");
  assert_same_in(a, b, "background.ply");
  assert_same_in(a, b, "sky.npz");
  assert_same_in(a, b, "log.jsonl");
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch(a), &scene), PAGS_OK);
  assert_true(scene.model_count > 1);
  for (int64_t i = 1; i < scene.model_count; i++)
    assert_same_in(a, b, scene.models[i].file);
  pags_scene_destroy(&scene);
}

static void the_scene_has_all_parts_of_the_street(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  pags_scene scene;
  pags_train_result result = train(&config, "whole", tasks, 1000, 0);
  assert_int_equal(result.finished, 1);
  assert_int_equal(result.bad_rows, 0);
  assert_true(result.psnr > 18.0); /* predicting the mean colour everywhere reaches about 13 dB */
  assert_int_equal(pags_scene_load(scratch("whole"), &scene), PAGS_OK);
  assert_true(scene.sky.size > 0);
  assert_int_equal(scene.object_count, pags_dataset_object_count(dataset));
  assert_true(scene.time_end > scene.time_begin);
  int64_t moving = 0, moved = 0, parked = 0;
  for (int64_t i = 0; i < scene.object_count; i++) {
    const pags_scene_object *o = &scene.objects[i];
    moving += o->model >= 0;
    assert_true(o->model < 0 || o->record.moving);
    for (int64_t k = 0; k < o->record.keyframe_count; k++)
      moved += o->model >= 0 && fabs(o->record.keyframes[k].translation[0]) > 0.0;
  }
  for (int64_t i = 0; scene.models[0].gaussians.object_id && i < scene.models[0].gaussians.count; i++)
    parked += scene.models[0].gaussians.object_id[i] >= 0;
  assert_true(moving >= 1 && moving == scene.model_count - 1);
  assert_true(moved > 0);  /* the poses of moving objects were optimised */
  assert_true(parked > 0); /* parked cars are separated from the background */
  pags_scene_destroy(&scene);
}

static void threads_and_interruptions_change_no_bit(void **unused) {
  (void)unused;
  pags_train_config config = quick(), half = quick();
  pags_tasks *one = pags_tasks_create(1);
  train(&config, "one", one, 1000, 0);
  train(&config, "two", tasks, 37, 0);
  assert_same_run("one", "two");
  half.schedule.schedule_iterations = ITERATIONS;
  half.schedule.iterations = 71; /* after the tracks' optimisation began, before densification ends */
  train(&half, "resumed", tasks, 1000, 0);
  half.schedule.iterations = ITERATIONS;
  pags_train_result result = train(&half, "resumed", one, 1000, 1);
  assert_int_equal(result.resumed, 1);
  assert_same_in("one", "resumed", "background.ply");
  assert_same_in("one", "resumed", "log.jsonl");
  assert_same_in("one", "resumed", "sky.npz");
  pags_tasks_destroy(one);
}

/* A limit on the size holds with the sky's file, whose size is known only in the end. */
static void the_size_limit_includes_the_sky(void **unused) {
  (void)unused;
  for (int prunes = 0; prunes <= 2; prunes += 2) {
    pags_train_config config = quick();
    config.priority.prunes = prunes;
    config.size_limit.target_size = 1.25;
    char name[16];
    snprintf(name, sizeof name, "limited%d", prunes);
    train(&config, name, tasks, 1000, 0);
    pags_scene scene;
    double bytes = 0;
    assert_int_equal(pags_scene_load(scratch(name), &scene), PAGS_OK);
    for (int64_t i = -2; i < scene.model_count; i++) {
      char path[1024];
      uint64_t size = 0;
      snprintf(path, sizeof path, "%s/%s", scratch(name),
               i == -2   ? "scene.json"
               : i == -1 ? "sky.npz"
                         : scene.models[i].file);
      assert_int_equal(pags_file_size(path, &size), PAGS_OK);
      bytes += (double)size;
    }
    print_message("%.0f bytes\n", bytes);
    assert_true(bytes <= 1.25e6);
    assert_true(bytes > 0.8e6);
    pags_scene_destroy(&scene);
  }
}

static double mean_s_sem(const pags_gaussians *g) {
  double sum = 0.0;
  assert_non_null(g->s_sem);
  for (int64_t i = 0; i < g->count; i++)
    sum += (double)g->s_sem[i] / (double)g->count;
  return sum;
}

/* A run that is interrupted and resumed has the bits of an uninterrupted one; two prunes lie before the interruption
 * and two after it. */
static void pruned_runs_go_on(const pags_train_config *config, const char *name) {
  char whole[32], parts[32];
  pags_train_config half = *config;
  pags_scene scene;
  pags_tasks *one = pags_tasks_create(1);
  snprintf(whole, sizeof whole, "%s_whole", name);
  snprintf(parts, sizeof parts, "%s_parts", name);
  pags_train_result result = train(config, whole, one, 1000, 0);
  half.schedule.schedule_iterations = ITERATIONS;
  half.schedule.iterations = 71;
  train(&half, parts, tasks, 1000, 0);
  half.schedule.iterations = ITERATIONS;
  result = train(&half, parts, tasks, 1000, 1);
  assert_int_equal(result.resumed, 1);
  assert_same_in(whole, parts, "background.ply");
  assert_same_in(whole, parts, "log.jsonl");
  assert_int_equal(pags_scene_load(scratch(whole), &scene), PAGS_OK);
  for (int64_t i = 1; i < scene.model_count; i++)
    assert_true(mean_s_sem(&scene.models[i].gaussians) > mean_s_sem(&scene.models[0].gaussians));
  pags_scene_destroy(&scene);
  pags_tasks_destroy(one);
}

static void pruning_changes_no_bit_of_a_resumed_run(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  config.schedule.preset = PAGS_PRESET_PAPER;
  config.density.densify_until = 25000;
  config.priority.prunes = 4;
  config.priority.prune_from = 10000;
  config.priority.prune_every = 5000;
  config.priority.prune_floor = 20;
  config.priority.score = PAGS_SCORE_DEFAULT;
  config.size_limit.max_gaussians = 1500;
  pruned_runs_go_on(&config, "pass");
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch("pass_whole"), &scene), PAGS_OK);
  assert_int_equal(pags_scene_gaussian_count(&scene), 1500);
  pags_scene_destroy(&scene);
  config.priority.score = PAGS_SCORE_AUTO; /* the paper's */
  pruned_runs_go_on(&config, "training");
  config = quick();
  config.schedule.preset = PAGS_PRESET_DEFAULT;
  config.priority.prune_floor = 20;
  config.density.lidar_pull = config.density.lidar_lay = 0.5;
  pruned_runs_go_on(&config, "default");
}

static void parts_can_be_left_out(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  pags_scene scene;
  config.schedule.iterations = 20;
  config.objects.objects = config.sky.sky = config.exposure.exposure = config.start.lidar_start = 0;
  config.losses.depth_weight = 0.0;
  train(&config, "bare", tasks, 1000, 0);
  assert_int_equal(pags_scene_load(scratch("bare"), &scene), PAGS_OK);
  assert_int_equal(scene.model_count, 1);
  assert_int_equal(scene.sky.size, 0);
  for (int64_t i = 0; i < scene.view_count; i++)
    assert_true(scene.views[i].gain[0] == 1.0 && scene.views[i].offset[0] == 0.0);
  pags_scene_destroy(&scene);
}

/* The limit of the count holds for objects and background together. The background gets at least a third of a small
 * limit, and objects get some Gaussians. */
static void the_count_limit_holds_for_all_models(void **unused) {
  (void)unused;
  pags_train_config config = quick();
  pags_scene scene;
  config.schedule.iterations = 40;
  for (int64_t bound = 60; bound <= 600; bound *= 10) {
    config.size_limit.max_gaussians = bound;
    train(&config, "bounded", tasks, 1000, 0);
    assert_int_equal(pags_scene_load(scratch("bounded"), &scene), PAGS_OK);
    assert_true(scene.model_count > 1);
    assert_true(scene.models[0].gaussians.count >= bound / 3);
    assert_in_range(pags_scene_gaussian_count(&scene), bound / 2, bound);
    pags_scene_destroy(&scene);
    assert_int_equal(pags_remove_tree(scratch("bounded")), PAGS_OK);
  }
}

static int64_t within_memory(int sky, uint64_t bytes) {
  pags_train_config config = quick();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  config.schedule.iterations = 10;
  config.sky.sky = sky;
  options.dataset = dataset;
  options.output = scratch("fitted");
  options.tasks = tasks;
  options.preview_every = 0;
  options.image_cache = 1 << 20;
  options.max_memory = options.image_cache + bytes;
  assert_int_equal(pags_train(&config, &options, &result), PAGS_OK);
  assert_int_equal(pags_remove_tree(scratch("fitted")), PAGS_OK);
  return result.gaussians;
}

/* The memory of a sky is counted: with a sky fewer Gaussians fit into the same memory. */
static void the_memory_limit_includes_the_sky(void **unused) {
  (void)unused;
  pags_scene scene;
  assert_int_equal(pags_scene_load(scratch("whole"), &scene), PAGS_OK);
  const int degree = quick().color.sh_degree;
  const uint64_t sky = pags_sky_fit_bytes(scene.sky.size), room = sky + pags_train_bytes(2000, degree, 96, 64);
  const int64_t with = within_memory(1, room), without = within_memory(0, room);
  assert_in_range(with, 1500, 2000);
  assert_true(without > with && sky + pags_train_bytes(with, degree, 96, 64) <= room);
  pags_scene_destroy(&scene);
}

/* Exposures of held-out views are interpolated between their neighbours', and the mean exposure over the training
 * views doesn't change. */
static void exposures_keep_their_mean(void **unused) {
  (void)unused;
  pags_scene scene;
  double gain = 0.0;
  int64_t training = 0;
  assert_int_equal(pags_scene_load(scratch("whole"), &scene), PAGS_OK);
  for (int64_t i = 0; i < scene.view_count; i++) {
    const pags_scene_view *v = &scene.views[i];
    if (!v->test) {
      gain += v->gain[1];
      training++;
      continue;
    }
    assert_true(i > 0 && i + 1 < scene.view_count);
    double a = v[-1].gain[1], b = v[1].gain[1];
    assert_true(v->gain[1] >= fmin(a, b) - 1e-12 && v->gain[1] <= fmax(a, b) + 1e-12);
  }
  assert_true(fabs(gain / (double)training - 1.0) < 1e-9);
  pags_scene_destroy(&scene);
}

/* A small street seen by a rig of two cameras. */
static pags_dataset *open_pair(void) {
  pags_street_options options = pags_street_options_default();
  pags_dataset_options reading = pags_dataset_options_default();
  pags_dataset *pair = NULL;
  options.width = options.height = 32;
  options.frames = 6;
  options.cameras = 2;
  options.samples = 1;
  options.objects = 0;
  options.lidar_points = 0;
  options.shifts = 0;
  assert_int_equal(pags_synth_street(scratch("pair"), &options, tasks, NULL, NULL), PAGS_OK);
  assert_int_equal(pags_dataset_open(scratch("pair"), &reading, &pair), PAGS_OK);
  return pair;
}

static double mean_gain(const pags_exposures *e, const pags_dataset *pair) {
  double value[6], sum = 0.0;
  int training = 0;
  for (int64_t i = 0; i < e->count; i++)
    if (!pags_dataset_view(pair, i)->test) {
      pags_exposures_value(e, pair, i, value);
      sum += value[0];
      training++;
    }
  return sum / training;
}

/* If one of two cameras is exposed more, also its photographs that training hasn't visited get that exposure. The
 * mean over the training views stays 1. */
static void a_camera_is_exposed_as_its_photographs(void **unused) {
  (void)unused;
  enum { STEPS = 2000 };
  pags_dataset *pair = open_pair();
  pags_train_config config = pags_train_config_default();
  config.schedule.iterations = STEPS;
  pags_schedule schedule = pags_schedule_make(&config, 10.0, pags_dataset_view_count(pair));
  pags_exposures e;
  /* The first training view of each camera is trained, its last isn't. */
  int64_t seen[2] = {-1, -1}, other[2] = {-1, -1};
  double value[6];
  assert_int_equal(pags_exposures_create(&e, pair), PAGS_OK);
  for (int64_t i = 0; i < e.count; i++) {
    const pags_view *v = pags_dataset_view(pair, i);
    if (!v->test)
      *(seen[v->sensor] < 0 ? &seen[v->sensor] : &other[v->sensor]) = i;
  }
  for (int step = 1; step <= STEPS; step++) {
    pags_exposures_value(&e, pair, seen[step % 2], value);
    double gradient[6] = {value[0] - (step % 2 ? 1.1 : 0.9)};
    pags_exposures_update(&e, pair, seen[step % 2], gradient, &schedule, step);
  }
  for (int c = 0; c < 2; c++) {
    pags_exposures_value(&e, pair, other[c], value);
    assert_true(c ? value[0] > 1.02 : value[0] < 0.98);
  }
  assert_true(fabs(mean_gain(&e, pair) - 1.0) < 1e-9);
  pags_exposures_destroy(&e);
  pags_dataset_close(pair);
}

/* Sets up a run just before its last step, which uses photographs at full size. */
static void begin_run(pags_train_options *options, pags_trainer *t) {
  *options = pags_train_options_default();
  options->dataset = dataset;
  options->tasks = tasks;
  const pags_train_config asked = quick(), config = pags_config_resolve(&asked, true);
  *t = (pags_trainer){.options = options, .dataset = options->dataset, .tasks = options->tasks, .ranks = 1};
  assert_int_equal(pags_views_list(t), PAGS_OK);
  assert_int_equal(pags_photo_cache_create(t->dataset, t->tasks, options->image_cache, &t->cache), PAGS_OK);
  assert_int_equal(pags_trainer_start(t, &config), PAGS_OK);
  assert_int_equal(pags_share_run_begin(t), PAGS_OK);
  assert_int_equal(pags_view_render_create(t), PAGS_OK);
  pags_state_set_step(&t->state, ITERATIONS - 1);
}

static void end_run(pags_trainer *t) {
  pags_photo_cache_destroy(t->cache);
  pags_view_render_destroy(t);
  pags_state_destroy(&t->state);
  free(t->views);
  free(t->order);
  free(t->round);
}

/* The direction of the middle of a texel: the inverse of pags_sky_face, face by face. */
static void texel_direction(int64_t texel, int size, double out[3]) {
  const int face = (int)(texel / ((int64_t)size * size));
  const double s = 2.0 * ((double)(texel % size) + 0.5) / size - 1.0;
  const double t = 2.0 * ((double)(texel / size % size) + 0.5) / size - 1.0;
  const double all[6][3] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t}, {s, -1, -t}, {s, -t, 1}, {-s, -t, -1}};
  memcpy(out, all[face], 3 * sizeof *out);
}

static bool some_view_shows(const pags_dataset *of, const double direction[3]) {
  for (int64_t i = 0; i < pags_dataset_view_count(of); i++) {
    const pags_view *const v = pags_dataset_view(of, i);
    const double *const m = v->camera.world_from_camera;
    double local[3], pixel[2];
    for (int k = 0; k < 3; k++)
      local[k] = m[k] * direction[0] + m[4 + k] * direction[1] + m[8 + k] * direction[2];
    if (!v->test && pags_camera_project(&v->camera, local, pixel, NULL) && pixel[0] > 0 && pixel[0] < v->camera.width &&
        pixel[1] > 0 && pixel[1] < v->camera.height)
      return true;
  }
  return false;
}

/* What the size limit sets aside for a sky is enough for its file, and less than the whole sky undeflated: at the start
 * for noise wherever a view looks, later for what training has changed. */
static void the_size_limit_reserves_what_the_sky_takes(void **unused) {
  (void)unused;
  pags_train_options options;
  pags_trainer t;
  begin_run(&options, &t);
  pags_sky *const sky = &t.state.sky.sky;
  const int size = sky->size;
  const int64_t raw = 6 * 6 * (int64_t)size * size;
  int64_t with, without;
  uint64_t file;
  for (int64_t i = 0; i < 3 * (int64_t)size * size / 2; i++) /* half of a face, without any order */
    sky->texels[i] = (float)pags_rng_below(1, (uint64_t)i, 0, 4096) / 4096.0f;
  assert_int_equal(pags_sky_file_size(sky, &file), PAGS_OK);
  assert_true((int64_t)file > raw / 24); /* noise hardly packs */
  assert_int_equal(pags_size_limit_rows(t.dataset, &t.state, &with), PAGS_OK);
  sky->size = 0;
  assert_int_equal(pags_size_limit_rows(t.dataset, &t.state, &without), PAGS_OK);
  sky->size = size;
  print_message("file %llu, reserved %lld, undeflated %lld bytes\n", (unsigned long long)file,
                (long long)(without - with), (long long)raw);
  assert_true(without - with >= (int64_t)file && without - with < raw / 2);
  pags_state_set_step(&t.state, 0);
  for (int64_t i = 0; i < 6 * (int64_t)size * size; i++) {
    double direction[3], at[2];
    texel_direction(i, size, direction);
    assert_int_equal(pags_sky_face(direction, at), (int)(i / ((int64_t)size * size)));
    const bool shown = some_view_shows(t.dataset, direction);
    for (int c = 0; c < 3; c++)
      sky->texels[3 * i + c] = shown ? (float)pags_rng_below(1, (uint64_t)i, (uint64_t)c, 4096) / 4096.0f : 0.5f;
  }
  assert_int_equal(pags_sky_file_size(sky, &file), PAGS_OK);
  assert_int_equal(pags_size_limit_rows(t.dataset, &t.state, &with), PAGS_OK);
  print_message("at the start: file %llu, reserved %lld bytes\n", (unsigned long long)file,
                (long long)(without - with));
  assert_true(without - with >= (int64_t)file && without - with < raw);
  end_run(&t);
}

static uint64_t decoded_by(const pags_trainer *t) {
  uint64_t used, peak, decoded;
  pags_photo_cache_figures(t->cache, &used, &peak, &decoded);
  return decoded;
}

/* Scores measured at half size: each Gaussian covers a quarter of the pixels, plus 9 % as the low-pass filter is
 * equally wide in pixels. Its critical share agrees with that at full size except at outlines. Neither this pass nor
 * the test for colour over time decodes a photograph twice. */
static void half_size_gives_the_same_scores(void **unused) {
  (void)unused;
  pags_train_options options;
  pags_trainer t;
  pags_score_pass whole, rough;
  begin_run(&options, &t);
  const uint64_t before = decoded_by(&t); /* the initial sky may have decoded some photographs at a smaller size */
  assert_int_equal(pags_score_pass_measure(&t, PAGS_SCORE_PASS_WHOLE, &whole), PAGS_OK);
  const uint64_t once = decoded_by(&t);
  assert_true(once - before <= (uint64_t)t.view_count);
  assert_int_equal(pags_score_pass_measure(&t, PAGS_SCORE_PASS_ROUGH, &rough), PAGS_OK);
  assert_int_equal(pags_color_over_time_decide(&t), PAGS_OK);
  assert_int_equal(decoded_by(&t), once);
  assert_int_equal(whole.count, rough.count);
  double seen = 0.0, critical = 0.0, half_seen = 0.0, half_critical = 0.0, off = 0.0;
  int64_t rows = 0;
  for (int64_t i = 0; i < whole.count; i++) {
    seen += whole.seen[i], critical += whole.critical[i];
    half_seen += rough.seen[i], half_critical += rough.critical[i];
    if (rough.seen[i] < 4.0)
      continue;
    off += fabs(whole.critical[i] / whole.seen[i] - rough.critical[i] / rough.seen[i]);
    rows++;
  }
  assert_true(critical > 100.0 && rows > 100);
  assert_true(fabs(4.0 * half_seen / seen - 1.0) < 0.15);
  assert_true(fabs(half_critical / half_seen - critical / seen) < 0.003);
  assert_true(off / (double)rows < 0.02);
  pags_score_pass_destroy(&whole);
  pags_score_pass_destroy(&rough);
  end_run(&t);
}

/* The test for colour over time works at half size: photographs averaged from full size and photographs decoded at
 * half size give the same gain. */
static void colour_over_time_gains_match_at_half_size(void **unused) {
  (void)unused;
  pags_train_options options;
  pags_trainer t;
  begin_run(&options, &t);
  assert_int_equal(pags_color_over_time_decide(&t), PAGS_OK);
  const double whole = t.state.models[1].fourier_gain;
  pags_state_set_step(&t.state, ITERATIONS / 6);
  assert_int_equal(pags_color_over_time_decide(&t), PAGS_OK);
  assert_true(whole > 0.01);
  /* The gains differ by rounding to bytes before or after averaging. */
  assert_true(fabs(t.state.models[1].fourier_gain / whole - 1.0) < 0.02);
  end_run(&t);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(the_scene_has_all_parts_of_the_street),
      cmocka_unit_test(exposures_keep_their_mean),
      cmocka_unit_test(a_camera_is_exposed_as_its_photographs),
      cmocka_unit_test(threads_and_interruptions_change_no_bit),
      cmocka_unit_test(pruning_changes_no_bit_of_a_resumed_run),
      cmocka_unit_test(parts_can_be_left_out),
      cmocka_unit_test(the_count_limit_holds_for_all_models),
      cmocka_unit_test(the_memory_limit_includes_the_sky),
      cmocka_unit_test(the_size_limit_includes_the_sky),
      cmocka_unit_test(the_size_limit_reserves_what_the_sky_takes),
      cmocka_unit_test(half_size_gives_the_same_scores),
      cmocka_unit_test(colour_over_time_gains_match_at_half_size),
  };
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
