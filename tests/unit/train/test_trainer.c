/* SPDX-License-Identifier: Apache-2.0 */
/* Tests whole training runs on a small scene: what they learn, and their bits, which depend only on data,
 * configuration and seed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pags/compose.h>
#include <pags/frame.h>
#include <pags/image.h>
#include <pags/scene.h>
#include <pags/train.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#ifndef _WIN32
#include <signal.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>
#endif

#include "base/file.h"
#include "base/rng.h"
#include "system.h"
#include "train/exposure.h"
#include "train/gradient_store.h"

enum { VIEWS = 9, WIDTH = 80, HEIGHT = 64, TRUTH = 150, ITERATIONS = 160 };
static const double focal = 80.0;

static char root[160];
static pags_dataset *dataset;

static const char *in_root(const char *name) {
  static char path[4][320];
  static int next;
  next = (next + 1) % 4;
  snprintf(path[next], sizeof path[next], "%s/%s", root, name);
  return path[next];
}

static float uniform(uint64_t purpose, int i) {
  return (float)pags_rng_uniform(99, purpose, (uint64_t)i);
}

/* `gloss`: the term of SH degree 1 that makes all colours brighter from one side. */
static void make_truth(pags_gaussians *g, float gloss) {
  assert_int_equal(pags_gaussians_create(g, TRUTH, 1), PAGS_OK);
  for (int i = 0; i < TRUTH; i++) {
    for (int k = 0; k < 3; k++) {
      pags_plane(g, PAGS_MEAN + k)[i] = 2.0f * uniform((uint64_t)k, i) - 1.0f;
      pags_plane(g, PAGS_SCALE + k)[i] = logf(0.08f + 0.15f * uniform((uint64_t)(3 + k), i));
      pags_plane(g, PAGS_SH + k)[i] = 3.0f * uniform((uint64_t)(6 + k), i) - 1.5f;
      pags_plane(g, PAGS_SH + 9 + k)[i] = gloss;
    }
    pags_plane(g, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(g, PAGS_OPACITY)[i] = 2.0f;
  }
}

/* A camera on a circle of radius 4 at height 0.5 that looks at the centre; OpenCV axes, world z up. */
static pags_camera make_camera(int view, int views) {
  double angle = 6.283185307 * view / views, eye[3] = {4.0 * cos(angle), 4.0 * sin(angle), 0.5};
  double length = sqrt(16.25), z[3], x[3] = {-sin(angle), cos(angle), 0.0};
  for (int k = 0; k < 3; k++)
    z[k] = -eye[k] / length;
  double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]};
  pags_camera c = {.width = WIDTH, .height = HEIGHT, .fx = focal, .fy = focal, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
  for (int k = 0; k < 3; k++) {
    c.world_from_camera[4 * k] = x[k];
    c.world_from_camera[4 * k + 1] = y[k];
    c.world_from_camera[4 * k + 2] = z[k];
    c.world_from_camera[4 * k + 3] = eye[k];
  }
  return c;
}

static void save_view(pags_frame *frame, const pags_part *part, const pags_camera *camera, const char *path) {
  pags_frame_options options = pags_frame_options_default();
  pags_picture picture;
  pags_image image;
  options.background[2] = 0.3f;
  assert_int_equal(pags_frame_render(frame, part, 1, camera, &options, NULL, NULL, &picture), PAGS_OK);
  assert_int_equal(pags_image_create(&image, WIDTH, HEIGHT, 3, PAGS_F32), PAGS_OK);
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++)
      for (int c = 0; c < 3; c++)
        ((float *)image.data)[(y * WIDTH + x) * 3 + c] = picture.rgb[c][y * picture.stride + x];
  assert_int_equal(pags_image_save(path, &image), PAGS_OK);
  pags_image_destroy(&image);
}

/* Writes transforms.json, whose poses are in OpenGL axes: y and z are flipped. */
static void save_transforms(const char *folder, int views) {
  char path[192];
  snprintf(path, sizeof path, "%s/transforms.json", folder);
  FILE *f = fopen(path, "w");
  assert_non_null(f);
  fprintf(f, "{\"w\": %d, \"h\": %d, \"fl_x\": %g, \"fl_y\": %g, \"cx\": %g, \"cy\": %g, \"frames\": [", WIDTH, HEIGHT,
          focal, focal, WIDTH / 2.0, HEIGHT / 2.0);
  for (int v = 0; v < views; v++) {
    pags_camera c = make_camera(v, views);
    fprintf(f, "%s{\"file_path\": \"view%d.png\", \"transform_matrix\": [", v ? ", " : "", v);
    for (int k = 0; k < 3; k++) {
      const double *r = c.world_from_camera + 4 * k;
      fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", r[0], -r[1], -r[2], r[3]);
    }
    fprintf(f, "[0, 0, 0, 1]]}");
  }
  fprintf(f, "]}\n");
  fclose(f);
}

/* Makes the photographs of a scene and opens them; NULL on failure. */
static pags_dataset *make_set(const char *folder, int views, float gloss) {
  pags_gaussians truth;
  pags_clusters clusters;
  pags_frame *frame;
  pags_dataset *made = NULL;
  if (pags_make_dirs(folder) != PAGS_OK)
    return NULL;
  pags_tasks *tasks = pags_tasks_create(1);
  make_truth(&truth, gloss);
  assert_int_equal(pags_clusters_create(&clusters, TRUTH, 64), PAGS_OK);
  pags_clusters_update(&clusters, &truth, 0, clusters.count);
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  pags_part part = {
      .gaussians = &truth, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  for (int v = 0; v < views; v++) {
    char path[192];
    pags_camera camera = make_camera(v, views);
    snprintf(path, sizeof path, "%s/view%d.png", folder, v);
    save_view(frame, &part, &camera, path);
  }
  save_transforms(folder, views);
  pags_frame_destroy(frame);
  pags_clusters_destroy(&clusters);
  pags_gaussians_destroy(&truth);
  pags_tasks_destroy(tasks);
  pags_dataset_options options = pags_dataset_options_default();
  options.split_every = 0;
  options.random_points = 300;
  if (pags_dataset_open(folder, &options, &made) != PAGS_OK)
    print_message("%s\n", pags_error_message());
  return made;
}

static int make_data(void **unused) {
  (void)unused;
  if (!system_make_scratch(root, sizeof root))
    return -1;
  dataset = make_set(in_root("data"), VIEWS, 0.0f);
  return dataset ? 0 : -1;
}

static int remove_data(void **unused) {
  (void)unused;
  pags_dataset_close(dataset);
  return pags_remove_tree(root) == PAGS_OK ? 0 : -1;
}

static pags_train_config small_config(void) {
  pags_train_config c = pags_train_config_default();
  c.schedule.iterations = ITERATIONS;
  c.color.sh_degree = 1;
  c.schedule.resolution_floor = 16;
  c.schedule.preset = PAGS_PRESET_PLAIN;
  c.size_limit.max_gaussians = 700;
  c.picture.background[2] = 0.3;
  c.density.densify_from = 0;
  c.density.densify_gradient = 1e-4;
  c.picture.cluster_size = 16;
  return c;
}

static pags_result run(const pags_train_config *config, const char *output, int threads, pags_train_options options,
                       pags_train_result *result) {
  pags_tasks *tasks = pags_tasks_create(threads);
  options.dataset = dataset;
  options.output = output;
  options.tasks = tasks;
  options.log_every = 10;
  options.preview_every = 80;
  pags_result code = pags_train(config, &options, result);
  pags_tasks_destroy(tasks);
  return code;
}

/* Runs a whole training without resuming. */
static void train(const pags_train_config *config, const char *output, int threads, int checkpoint_every) {
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.checkpoint_every = checkpoint_every;
  pags_result code = run(config, output, threads, options, &result);
  if (code != PAGS_OK)
    print_message("%s\n", pags_error_message());
  assert_int_equal(code, PAGS_OK);
  assert_true(result.finished);
  assert_int_equal(result.iterations, config->schedule.iterations);
  assert_int_equal(result.bad_rows, 0);
}

static int is_same_file(const char *a, const char *b, const char *name) {
  char path[2][192];
  uint8_t *bytes[2];
  size_t size[2];
  for (int i = 0; i < 2; i++) {
    snprintf(path[i], sizeof path[i], "%s/%s", i ? b : a, name);
    assert_int_equal(pags_file_read(path[i], &bytes[i], &size[i]), PAGS_OK);
  }
  int same = size[0] == size[1] && memcmp(bytes[0], bytes[1], size[0]) == 0;
  free(bytes[0]);
  free(bytes[1]);
  return same;
}

/* Compares all files of two folders except the report, by name and content. */
static void assert_same_folder(const char *a, const char *b) {
  pags_dir_list x, y;
  assert_int_equal(pags_dir_list_read(a, &x), PAGS_OK);
  assert_int_equal(pags_dir_list_read(b, &y), PAGS_OK);
  assert_int_equal(x.count, y.count);
  assert_true(x.count >= 6);
  for (int64_t i = 0; i < x.count; i++) {
    assert_string_equal(x.names[i], y.names[i]);
    if (strcmp(x.names[i], "report.json") != 0)
      assert_true(is_same_file(a, b, x.names[i]));
  }
  pags_dir_list_destroy(&x);
  pags_dir_list_destroy(&y);
}

static void learns_the_scene(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  pags_scene scene;
  config.schedule.iterations = 600;
  assert_int_equal(run(&config, in_root("learn"), 2, options, &result), PAGS_OK);
  print_message("%lld Gaussians, %.2f dB\n", (long long)result.gaussians, result.psnr);
  assert_true(result.psnr > 25.0);
  assert_true(result.gaussians > 300 && result.gaussians <= 700);
  assert_int_equal(pags_scene_load(in_root("learn"), &scene), PAGS_OK);
  assert_int_equal(pags_scene_gaussian_count(&scene), result.gaussians);
  assert_int_equal(scene.view_count, VIEWS);
  assert_int_equal(scene.iterations, 600);
  pags_scene_destroy(&scene);
}

static void threads_and_checkpoints_change_no_bit(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  config.size_limit.sh_loss = 0.05;
  train(&config, in_root("one"), 1, 0);
  train(&config, in_root("two"), 2, 37);
  train(&config, in_root("five"), 5, 3);
  assert_same_folder(in_root("one"), in_root("two"));
  assert_same_folder(in_root("one"), in_root("five"));
}

static int stop_at(void *user, const pags_train_progress *progress) {
  return progress->step < *(const int64_t *)user;
}

/* Training with any number of threads, and in three pieces, gives the same bits; `names` are three folders. */
static void check_reproducible(const pags_train_config *config, const char *const names[3]) {
  const int64_t batch = config->schedule.batch, stops[] = {77, 118, config->schedule.iterations / batch};
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  train(config, in_root(names[0]), 1, 0);
  train(config, in_root(names[1]), 2, 41);
  assert_same_folder(in_root(names[0]), in_root(names[1]));
  options.resume = 1;
  options.progress = stop_at;
  for (int i = 0; i < 3; i++) {
    options.progress_user = (void *)(uintptr_t)&stops[i];
    assert_int_equal(run(config, in_root(names[2]), 1 + i, options, &result), PAGS_OK);
    assert_int_equal(result.iterations, stops[i] * batch);
  }
  assert_same_folder(in_root(names[0]), in_root(names[2]));
}

/* Dropout gives the same bits for any number of threads and through resuming, and other bits than a run without
 * dropout. */
static void dropout_is_reproducible(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  config.priority.dropout = 1;
  check_reproducible(&config, (const char *const[]){"drop1", "drop2", "drop3"});
  config.priority.dropout = 0;
  train(&config, in_root("drop4"), 2, 0);
  assert_false(is_same_file(in_root("drop1"), in_root("drop4"), "background.ply"));
}

/* Runs with several photographs a step are reproducible; the number of iterations is rounded up to whole steps. */
static void batches_are_reproducible(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  config.priority.dropout = 1;
  config.schedule.batch = 3;
  config.schedule.iterations = 3 * ITERATIONS;
  check_reproducible(&config, (const char *const[]){"batch1", "batch2", "batch3"});
  config.density.strategy = PAGS_STRATEGY_MCMC;
  config.size_limit.max_gaussians = 350;
  train(&config, in_root("batch4"), 1, 0);
  train(&config, in_root("batch5"), 3, 11);
  assert_same_folder(in_root("batch4"), in_root("batch5"));

  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  config.schedule.iterations = 10;
  assert_int_equal(run(&config, in_root("batch6"), 1, options, &result), PAGS_OK);
  assert_int_equal(result.iterations, 12);
  options.resume = 1;
  config.schedule.batch = 2;
  assert_int_equal(run(&config, in_root("batch6"), 1, options, &result), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "another batch"));
}

/* Gradients with the same stamp add up; a new stamp replaces them. */
static void a_store_adds_gradients_of_one_stamp(void **unused) {
  (void)unused;
  pags_gradient_store store = {0};
  const float a[3] = {1, -2, 0.5f}, b[3] = {0.25f, 4, -0.5f};
  assert_null(pags_gradient_store_find(&store, 1, 7));
  assert_int_equal(pags_gradient_store_reserve(&store, 2, 3), PAGS_OK);
  pags_gradient_store_add(&store, 1, 7, a, 3);
  pags_gradient_store_add(&store, 1, 7, b, 3);
  const float *const sum = pags_gradient_store_find(&store, 1, 7);
  assert_non_null(sum);
  assert_true(sum[0] == 1.25f && sum[1] == 2.0f && sum[2] == 0.0f);
  assert_null(pags_gradient_store_find(&store, 0, 7));
  pags_gradient_store_add(&store, 1, 8, b, 3);
  assert_null(pags_gradient_store_find(&store, 1, 7));
  assert_memory_equal(pags_gradient_store_find(&store, 1, 8), b, sizeof b);
  pags_gradient_store_destroy(&store);
}

static pags_dataset *open_one_view(void) {
  const pags_camera c = make_camera(0, VIEWS);
  assert_int_equal(pags_make_dirs(in_root("one_view")), PAGS_OK);
  FILE *f = fopen(in_root("one_view/transforms.json"), "w");
  assert_non_null(f);
  fprintf(f,
          "{\"w\": %d, \"h\": %d, \"fl_x\": %g, \"fl_y\": %g, \"cx\": %g, \"cy\": %g, \"frames\": "
          "[{\"file_path\": \"../data/view0.png\", \"transform_matrix\": [",
          WIDTH, HEIGHT, focal, focal, WIDTH / 2.0, HEIGHT / 2.0);
  for (int k = 0; k < 3; k++) {
    const double *r = c.world_from_camera + 4 * k;
    fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", r[0], -r[1], -r[2], r[3]);
  }
  fprintf(f, "[0, 0, 0, 1]]}]}\n");
  fclose(f);
  pags_dataset_options options = pags_dataset_options_default();
  pags_dataset *one = NULL;
  options.split_every = 0;
  options.random_points = 300;
  assert_int_equal(pags_dataset_open(in_root("one_view"), &options, &one), PAGS_OK);
  return one;
}

/* Returns the largest difference between the parameters of two scenes' first models. */
static double difference(const char *a, const char *b) {
  pags_scene scenes[2];
  double worst = 0;
  assert_int_equal(pags_scene_load(in_root(a), &scenes[0]), PAGS_OK);
  assert_int_equal(pags_scene_load(in_root(b), &scenes[1]), PAGS_OK);
  const pags_gaussians *const g = &scenes[0].models[0].gaussians, *const h = &scenes[1].models[0].gaussians;
  assert_int_equal(g->count, h->count);
  for (int p = 0; p < pags_plane_count(g->sh_degree); p++)
    for (int64_t i = 0; i < g->count; i++)
      worst = fmax(worst, fabs((double)pags_plane(g, p)[i] - (double)pags_plane(h, p)[i]));
  pags_scene_destroy(&scenes[0]);
  pags_scene_destroy(&scenes[1]);
  return worst;
}

/* A step that sees one photograph twice equals a step that sees it once: gradients are averaged, Adam's decays
 * squared and its rates multiplied by root 2. */
static void a_step_averages_its_photographs(void **unused) {
  (void)unused;
  const double root2 = sqrt(2.0);
  pags_dataset *const whole = dataset;
  pags_train_config twice = small_config();
  twice.exposure.exposure = 0; /* exposure is updated once for each photograph */
  twice.density.densify_from = 30000;
  twice.schedule.quarter_until = 0;
  twice.schedule.half_until = 0;
  twice.schedule.batch = 2;
  twice.schedule.iterations = 80;
  twice.optimiser.position_rate_begin = 1.6e-4, twice.optimiser.position_rate_end = 1.6e-6;
  twice.optimiser.scale_rate = 0.005, twice.optimiser.sh_dc_rate = 0.0025, twice.optimiser.sh_rest_rate = 0.000125;
  pags_train_config once = twice;
  pags_train_optimiser *const o = &once.optimiser;
  once.schedule.batch = 1;
  once.schedule.iterations = 40;
  o->beta1 *= o->beta1, o->beta2 *= o->beta2;
  double *const rates[] = {&o->position_rate_begin, &o->position_rate_end, &o->scale_rate,  &o->rotation_rate,
                           &o->opacity_rate,        &o->sh_dc_rate,        &o->sh_rest_rate};
  dataset = open_one_view();
  train(&once, in_root("slow"), 2, 0);
  for (size_t i = 0; i < sizeof rates / sizeof *rates; i++)
    *rates[i] *= root2;
  train(&once, in_root("once"), 2, 0);
  train(&twice, in_root("twice"), 2, 0);
  assert_true(difference("twice", "once") < 1e-4);
  assert_true(difference("twice", "slow") > 0.1);
  pags_dataset_close(dataset);
  dataset = whole;
}

/* Runs with a least alpha and scale resets are reproducible; the scene stores the least alpha. */
static void shorter_lists_are_reproducible(void **unused) {
  (void)unused;
  pags_scene scene;
  pags_train_config config = small_config();
  config.picture.alpha_min = 4.0 / 255;
  config.density.scale_reset = 0.6;
  config.schedule.iterations = 400; /* enough steps for a reset */
  check_reproducible(&config, (const char *const[]){"short1", "short2", "short3"});
  assert_int_equal(pags_scene_load(in_root("short1"), &scene), PAGS_OK);
  assert_true(scene.models[0].gaussians.alpha_min == (float)(4.0 / 255));
  pags_scene_destroy(&scene);
  config.density.scale_reset = 1;
  train(&config, in_root("short4"), 2, 0);
  assert_false(is_same_file(in_root("short1"), in_root("short4"), "background.ply"));
}

static void mcmc_is_reproducible(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  config.density.strategy = PAGS_STRATEGY_MCMC;
  config.size_limit.max_gaussians = 350;
  train(&config, in_root("mcmc1"), 1, 0);
  train(&config, in_root("mcmc3"), 3, 11);
  assert_same_folder(in_root("mcmc1"), in_root("mcmc3"));
}

static void stopping_and_resuming_changes_no_bit(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  static const int64_t stops[] = {1, 25, 26, 119, ITERATIONS};
  config.size_limit.sh_loss = 0.05;
  train(&config, in_root("straight"), 2, 50);
  options.resume = 1;
  options.progress = stop_at;
  for (int i = 0; i < 5; i++) {
    options.progress_user = (void *)(uintptr_t)&stops[i];
    assert_int_equal(run(&config, in_root("stopped"), 1 + i % 3, options, &result), PAGS_OK);
    assert_int_equal(result.finished, stops[i] == ITERATIONS);
    assert_int_equal(result.iterations, stops[i]);
    assert_int_equal(result.resumed, i > 0);
  }
  assert_same_folder(in_root("straight"), in_root("stopped"));
}

#ifndef _WIN32 /* fork doesn't exist there */
/* Trains in a child process that is killed after some milliseconds. Returns 1 if it had finished before. */
static int train_and_kill(const pags_train_config *config, const char *output, long milliseconds) {
  int status;
  pid_t child = fork();
  assert_true(child >= 0);
  if (child == 0) {
    pags_train_options options = pags_train_options_default();
    pags_train_result result;
    options.resume = 1;
    options.checkpoint_every = 7;
    _exit(run(config, output, 2, options, &result) == PAGS_OK ? 0 : 1);
  }
  nanosleep(&(struct timespec){milliseconds / 1000, milliseconds % 1000 * 1000000}, NULL);
  kill(child, SIGKILL);
  assert_int_equal(waitpid(child, &status, 0), child);
  if (WIFEXITED(status))
    assert_int_equal(WEXITSTATUS(status), 0);
  return WIFEXITED(status);
}

static void being_killed_changes_no_bit(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  train(&config, in_root("alive"), 2, 7);
  int kills = 0;
  for (int i = 0; i < 3; i++)
    kills += !train_and_kill(&config, in_root("killed"), 60 + 90 * i);
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.resume = 1;
  assert_int_equal(run(&config, in_root("killed"), 2, options, &result), PAGS_OK);
  print_message("killed %d times\n", kills);
  assert_true(result.finished);
  assert_same_folder(in_root("alive"), in_root("killed"));
}
#endif

static void resuming_may_continue_only_the_same_run(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  train(&config, in_root("further"), 2, 0);
  options.resume = 1;
  config.optimiser.scale_rate *= 2.0;
  assert_int_equal(run(&config, in_root("further"), 2, options, &result), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "scale_rate"));
  config = small_config();
  config.schedule.iterations = ITERATIONS - 1;
  assert_int_equal(run(&config, in_root("further"), 2, options, &result), PAGS_ERROR_ARGUMENT);
  config.schedule.iterations = ITERATIONS + 30;
  assert_int_equal(run(&config, in_root("further"), 2, options, &result), PAGS_OK);
  assert_true(result.finished && result.resumed);
  assert_int_equal(result.iterations, ITERATIONS + 30);
  /* A finished job is started again, as a cluster's queue may do: nothing is left to do. */
  assert_int_equal(run(&config, in_root("further"), 2, options, &result), PAGS_OK);
  assert_int_equal(result.iterations, ITERATIONS + 30);
}

static void a_folder_in_use_is_refused_untouched(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  pags_dir_list list;
  assert_int_equal(pags_make_dirs(in_root("mine")), PAGS_OK);
  assert_int_equal(pags_file_write(in_root("mine/letter.txt"), "dear", 4), PAGS_OK);
  assert_int_equal(run(&config, in_root("mine"), 1, options, &result), PAGS_ERROR_ARGUMENT);
  assert_non_null(strstr(pags_error_message(), "mine"));
  assert_int_equal(pags_dir_list_read(in_root("mine"), &list), PAGS_OK);
  assert_int_equal(list.count, 1);
  pags_dir_list_destroy(&list);
  options.overwrite = 1;
  assert_int_equal(run(&config, in_root("mine"), 1, options, &result), PAGS_OK);
  assert_true(pags_file_exists(in_root("mine/letter.txt"))); /* a file of the user is kept */
  assert_int_equal(run(&config, in_root("mine/letter.txt"), 1, options, &result), PAGS_ERROR_IO);
  options.overwrite = 0;
  assert_int_equal(run(&config, SYSTEM_NO_PLACE, 1, options, &result), PAGS_ERROR_IO);
}

/* Saves a scene of a background and two models, one of them in the folder objects/. */
static void save_old_scene(const char *folder) {
  pags_model models[3] = {{.name = (char[]){"background"}, .file = (char[]){"background.ply"}},
                          {.name = (char[]){"car"}, .file = (char[]){"objects/car.ply"}},
                          {.name = (char[]){"tree"}, .file = (char[]){"tree.ply"}}};
  pags_scene scene = {.model_count = 3, .models = models};
  for (int i = 0; i < 3; i++)
    assert_int_equal(pags_gaussians_create(&models[i].gaussians, 1, 0), PAGS_OK);
  assert_int_equal(pags_scene_save(folder, &scene), PAGS_OK);
  for (int i = 0; i < 3; i++)
    pags_gaussians_destroy(&models[i].gaussians);
}

static void overwriting_removes_what_the_scene_names(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.overwrite = 1;
  config.schedule.iterations = 5;
  save_old_scene(in_root("old"));
  assert_int_equal(pags_file_write(in_root("old/objects/mine.ply"), "ply", 3), PAGS_OK);
  assert_int_equal(pags_file_write(in_root("old/sky.npz"), "not the scene's", 15), PAGS_OK);
  assert_int_equal(run(&config, in_root("old"), 1, options, &result), PAGS_OK);
  assert_false(pags_file_exists(in_root("old/objects/car.ply")));
  assert_false(pags_file_exists(in_root("old/tree.ply")));
  assert_true(pags_file_exists(in_root("old/objects/mine.ply")) && pags_file_exists(in_root("old/sky.npz")));
  assert_true(pags_file_exists(in_root("old/background.ply")));
  save_old_scene(in_root("older"));
  assert_int_equal(run(&config, in_root("older"), 1, options, &result), PAGS_OK);
  assert_false(pags_path_exists(in_root("older/objects")));
}

static void an_estimate_writes_nothing(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  options.estimate = 1;
  assert_int_equal(run(&config, in_root("estimate"), 2, options, &result), PAGS_OK);
  assert_false(pags_path_exists(in_root("estimate")));
  assert_true(result.estimated_seconds > 0.0 && result.estimated_bytes > 1 << 20);
}

static void a_time_limit_sets_the_steps(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  config.schedule.iterations = 10000000;
  options.time_limit_seconds = 2.0;
  assert_int_equal(run(&config, in_root("limit"), 2, options, &result), PAGS_OK);
  print_message("%lld steps in %.2f s\n", (long long)result.iterations, result.seconds);
  assert_true(result.iterations < 1000000);
  /* On a busy machine the run may not reach the stage that fits its length to the time. */
  assert_true(result.finished || result.seconds >= 2.0);
}

static void memory_limits_the_count(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  config.size_limit.max_gaussians = 0;
  options.max_memory = 1; /* too little memory for any count: the lower bound of 1024 applies */
  assert_int_equal(run(&config, in_root("memory"), 2, options, &result), PAGS_OK);
  assert_true(result.gaussians <= 1024);
}

static uint64_t scene_bytes(const char *folder) {
  static const char *const files[] = {"scene.json", "background.ply", "background-sh0.ply", "background-sh1.ply"};
  uint64_t sum = 0;
  for (int i = 0; i < 4; i++) {
    char path[192];
    uint64_t bytes = 0;
    snprintf(path, sizeof path, "%s/%s", folder, files[i]);
    if (pags_file_exists(path))
      assert_int_equal(pags_file_size(path, &bytes), PAGS_OK);
    sum += bytes;
  }
  return sum;
}

/* target_size limits the count: growth stops there, a start that is too large is thinned, and an impossible size is
 * refused. */
static void target_size_limits_the_count(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  config.size_limit.max_gaussians = 0;
  for (int i = 0; i < 3; i++) { /* in the third run the last prune reaches the size */
    char name[16];
    snprintf(name, sizeof name, "size%d", i);
    config.size_limit.target_size = i ? 0.036 : 0.1;
    config.schedule.preset = i == 2 ? PAGS_PRESET_PAPER : PAGS_PRESET_PLAIN;
    config.priority.prunes = i == 2 ? 4 : 0;
    config.priority.prune_from = 10000;
    config.priority.prune_every = 5000;
    config.priority.dropout = 0;
    config.density.densify_until = i == 2 ? 25000 : 15000;
    assert_int_equal(run(&config, in_root(name), 2, options, &result), PAGS_OK);
    const uint64_t bytes = scene_bytes(in_root(name));
    print_message("%g MB: %lld Gaussians, %llu bytes\n", config.size_limit.target_size, (long long)result.gaussians,
                  (unsigned long long)bytes);
    assert_true((double)bytes <= config.size_limit.target_size * 1e6);
    /* scene.json may still grow by this reserve. */
    assert_true((double)bytes >= config.size_limit.target_size * 1e6 - 14000.0);
  }
  config.size_limit.target_size = 0.001;
  config.schedule.preset = PAGS_PRESET_PLAIN;
  assert_int_equal(run(&config, in_root("size3"), 2, options, &result), PAGS_ERROR_LIMIT);
  const char *needed = strstr(pags_error_message(), "take ");
  assert_non_null(strstr(pags_error_message(), "target_size"));
  assert_non_null(needed);
  const double least = atof(needed + strlen("take "));
  config.size_limit.target_size = least - 0.001; /* the size in the message is rounded up to a thousandth */
  assert_int_equal(run(&config, in_root("size3"), 2, options, &result), PAGS_ERROR_LIMIT);
  config.size_limit.target_size = least;
  assert_int_equal(run(&config, in_root("size3"), 2, options, &result), PAGS_OK);
}

/* Mean PSNR of the photographs, of which all are training views, in a trained scene, dB. */
static double psnr_of(const char *folder) {
  pags_tasks *tasks = pags_tasks_create(2);
  pags_composition *composition;
  pags_photo_cache *cache;
  pags_frame *frame;
  const int64_t views = pags_dataset_view_count(dataset);
  double sum = 0.0;
  assert_int_equal(pags_photo_cache_create(dataset, tasks, 1 << 20, &cache), PAGS_OK);
  assert_int_equal(pags_composition_load(folder, &composition), PAGS_OK);
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  const pags_frame_options options = pags_composition_options(composition);
  for (int64_t v = 0; v < views; v++) {
    const pags_camera camera = pags_dataset_view(dataset, v)->camera;
    const pags_part *parts;
    pags_picture picture;
    pags_photo photo;
    double squares = 0.0;
    int count;
    pags_compose(composition, NAN, &parts, &count);
    assert_int_equal(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
    assert_int_equal(pags_photo_cache_get(cache, v, 1, &photo), PAGS_OK);
    for (int y = 0; y < HEIGHT; y++)
      for (int x = 0; x < WIDTH; x++)
        for (int c = 0; c < 3; c++) {
          const float drawn = fminf(fmaxf(picture.rgb[c][y * picture.stride + x], 0.0f), 1.0f);
          const double away = (double)drawn - photo.rgb[(c * HEIGHT + y) * photo.stride + x] / 255.0;
          squares += away * away / (3.0 * WIDTH * HEIGHT);
        }
    sum -= 10.0 * log10(squares);
  }
  pags_photo_cache_destroy(cache);
  pags_frame_destroy(frame);
  pags_composition_destroy(composition);
  pags_tasks_destroy(tasks);
  return sum / (double)views;
}

/* Counts the Gaussians of a trained scene by the SH degree that they are stored with. */
static void count_degrees(const char *folder, int64_t count[4]) {
  pags_scene scene;
  memset(count, 0, 4 * sizeof *count);
  assert_int_equal(pags_scene_load(folder, &scene), PAGS_OK);
  for (int64_t m = 0; m < scene.model_count; m++)
    count[scene.models[m].gaussians.sh_degree] += scene.models[m].gaussians.count;
  pags_scene_destroy(&scene);
}

/* A scene without view dependence stores no SH with an sh_loss with which one with gloss keeps some. Training
 * photographs lose no more than that, and the scene gets smaller. */
static void sh_degrees_follow_the_benefit(void **unused) {
  (void)unused;
  enum { MANY = 24 };
  static const double losses[] = {0.0, 0.05, 0.6};
  pags_dataset *const before = dataset;
  pags_train_config config = small_config();
  config.color.sh_interval = 3000;
  config.optimiser.sh_rest_rate = 0.0004;
  config.schedule.iterations = 400;
  for (int gloss = 0; gloss < 2; gloss++) {
    double psnr[3];
    int64_t count[3][4];
    uint64_t bytes[3];
    dataset = make_set(in_root(gloss ? "glossy" : "diffuse"), MANY, gloss ? 0.6f : 0.0f);
    assert_non_null(dataset);
    for (int k = 0; k < 3; k++) {
      char name[16];
      snprintf(name, sizeof name, "sh%d%d", gloss, k);
      config.size_limit.sh_loss = losses[k];
      train(&config, in_root(name), 2, 0);
      psnr[k] = psnr_of(in_root(name));
      bytes[k] = scene_bytes(in_root(name));
      count_degrees(in_root(name), count[k]);
      print_message("gloss %d, sh_loss %g: %.3f dB, %lld Gaussians of degree 0, %lld of 1, %llu bytes\n", gloss,
                    losses[k], psnr[k], (long long)count[k][0], (long long)count[k][1], (unsigned long long)bytes[k]);
      assert_true(psnr[0] - psnr[k] <= losses[k] + 1e-3);
    }
    assert_true(count[0][0] == 0 && count[1][0] > 0 && count[1][1] > 0);
    assert_true(bytes[2] < bytes[1] && bytes[1] < bytes[0]);
    assert_true(gloss ? count[2][1] > 0 : count[2][1] == 0);
    pags_dataset_close(dataset);
  }
  dataset = before;
}

/* Watches a run after every step, and stops it at a given step. */
typedef struct onlooker {
  pags_tasks *tasks;
  pags_frame *frame;
  int64_t stop_at, looks;
  double difference; /* largest difference of the last picture from that of the step before, 0..1 */
  float *last;
} onlooker;

static void draw_look(pags_composition *composition, pags_frame *frame, float *out) {
  const pags_camera camera = pags_dataset_view(dataset, 2)->camera;
  const pags_frame_options options = pags_composition_options(composition);
  const pags_part *parts;
  pags_picture picture;
  int count;
  pags_compose(composition, (double)NAN, &parts, &count);
  assert_int_equal(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture), PAGS_OK);
  for (int y = 0; y < HEIGHT; y++)
    memcpy(out + (size_t)y * WIDTH, picture.rgb[1] + (size_t)y * (size_t)picture.stride, WIDTH * sizeof *out);
}

static double most_apart(const float *a, const float *b) {
  double most = 0;
  for (int i = 0; i < WIDTH * HEIGHT; i++)
    most = fmax(most, fabs((double)a[i] - (double)b[i]));
  return most;
}

static int look_on(void *user, const pags_train_progress *progress) {
  onlooker *o = user;
  pags_composition *composition;
  float seen[WIDTH * HEIGHT];
  assert_int_equal(pags_train_moment_compose(progress->moment, &composition), PAGS_OK);
  assert_int_equal(pags_composition_gaussian_count(composition), progress->gaussians);
  draw_look(composition, o->frame, seen);
  pags_train_moment_release(progress->moment, composition);
  o->difference = most_apart(seen, o->last);
  memcpy(o->last, seen, sizeof seen);
  if (o->looks++ % 50 == 7)
    assert_int_equal(pags_train_moment_save(progress->moment), PAGS_OK);
  return progress->step < o->stop_at;
}

/* The picture seen by a callback after the last step is that of the saved scene. Rows have another order, so
 * Gaussians of equal depth may be blended in reverse: 1/255. */
static void callbacks_change_no_bit(void **unused) {
  (void)unused;
  pags_train_config config = small_config();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  float last[WIDTH * HEIGHT] = {0}, scene[WIDTH * HEIGHT];
  onlooker o = {.tasks = pags_tasks_create(2), .last = last};
  pags_composition *composition;
  config.priority.dropout = 1;
  train(&config, in_root("alone"), 1, 0);
  assert_int_equal(pags_frame_create(o.tasks, &o.frame), PAGS_OK);
  options.resume = 1;
  options.progress = look_on;
  options.progress_user = &o;
  for (o.stop_at = 93; o.stop_at <= ITERATIONS; o.stop_at += ITERATIONS - 93) {
    assert_int_equal(run(&config, in_root("watched"), 2, options, &result), PAGS_OK);
    assert_true(result.seconds_watched > 0);
  }
  assert_int_equal(o.looks, ITERATIONS);
  assert_true(o.difference > 0);
  assert_same_folder(in_root("alone"), in_root("watched"));
  assert_int_equal(pags_composition_load(in_root("watched"), &composition), PAGS_OK);
  draw_look(composition, o.frame, scene);
  assert_true(most_apart(scene, last) < 1.0 / 255);
  pags_composition_destroy(composition);
  pags_frame_destroy(o.frame);
  pags_tasks_destroy(o.tasks);
}

/* If exposures change smoothly in the order of names, photographs were taken in this order, and a held-out photograph
 * gets an exposure between its neighbours'. Otherwise names don't help. */
static void exposures_may_follow_names(void **unused) {
  (void)unused;
  pags_exposures e;
  double value[6];
  assert_int_equal(pags_exposures_create(&e, dataset), PAGS_OK);
  assert_false(pags_exposures_follow_names(&e, dataset)); /* equal exposures give no evidence */
  for (int i = 0; i < VIEWS; i++)
    e.items[i].value[0] = 1 + 0.1 * sin(0.7 * i);
  assert_true(pags_exposures_follow_names(&e, dataset));
  pags_exposures_between(&e, dataset, 4, value);
  assert_true(fabs(value[0] - 1 - 0.05 * (sin(2.1) + sin(3.5))) < 1e-12);
  pags_exposures_between(&e, dataset, 0, value); /* the first photograph has one neighbour */
  assert_true(fabs(value[0] - 1 - 0.1 * sin(0.7)) < 1e-12);
  for (int i = 0; i < VIEWS; i++)
    e.items[i].value[0] = 1 + 0.1 * uniform(50, i) - 0.05;
  assert_false(pags_exposures_follow_names(&e, dataset));
  pags_exposures_destroy(&e);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(learns_the_scene),
      cmocka_unit_test(threads_and_checkpoints_change_no_bit),
      cmocka_unit_test(dropout_is_reproducible),
      cmocka_unit_test(batches_are_reproducible),
      cmocka_unit_test(a_store_adds_gradients_of_one_stamp),
      cmocka_unit_test(a_step_averages_its_photographs),
      cmocka_unit_test(shorter_lists_are_reproducible),
      cmocka_unit_test(callbacks_change_no_bit),
      cmocka_unit_test(exposures_may_follow_names),
      cmocka_unit_test(mcmc_is_reproducible),
      cmocka_unit_test(stopping_and_resuming_changes_no_bit),
#ifndef _WIN32
      cmocka_unit_test(being_killed_changes_no_bit),
#endif
      cmocka_unit_test(resuming_may_continue_only_the_same_run),
      cmocka_unit_test(a_folder_in_use_is_refused_untouched),
      cmocka_unit_test(overwriting_removes_what_the_scene_names),
      cmocka_unit_test(an_estimate_writes_nothing),
      cmocka_unit_test(a_time_limit_sets_the_steps),
      cmocka_unit_test(memory_limits_the_count),
      cmocka_unit_test(target_size_limits_the_count),
      cmocka_unit_test(sh_degrees_follow_the_benefit),
  };
  return cmocka_run_group_tests(tests, make_data, remove_data);
}
