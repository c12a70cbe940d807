/* SPDX-License-Identifier: Apache-2.0 */
/* Writes the small data set of the hard cases and trains on it; see hard.h. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/image.h>
#include <pags/scene.h>

#include "base/rng.h"
#include "scratch_folder.h"
#include "train/checkpoint.h"

int hard_leaves_out(void) {
  const int is_short = getenv("HARD_SHORT") != NULL;
  if (is_short)
    print_message("  left out here: the run without HARD_SHORT has it\n");
  return is_short;
}

int hard_begin(void **state) {
  (void)state;
  return scratch_make();
}

int hard_end(void **state) {
  (void)state;
  return scratch_remove();
}

const char *hard_path(const char *name) {
  return scratch(name);
}

static void check(pags_result result) {
  if (result != PAGS_OK)
    fail_msg("%s: %s", pags_result_name(result), pags_error_message());
}

enum { NAME = 96 };

static void join(char path[NAME], const char *folder, const char *file) {
  assert_true(snprintf(path, NAME, "%s/%s", folder, file) < NAME);
}

/* ---- Data ---- */

static float uniform(uint64_t purpose, int i) {
  return (float)pags_rng_uniform(88, purpose, (uint64_t)i);
}

void hard_truth(pags_gaussians *g) {
  check(pags_gaussians_create(g, HARD_TRUTH, 1));
  for (int i = 0; i < HARD_TRUTH; i++) {
    for (int k = 0; k < 3; k++) {
      pags_plane(g, PAGS_MEAN + k)[i] = 2.0f * uniform((uint64_t)k, i) - 1.0f;
      pags_plane(g, PAGS_SCALE + k)[i] = logf(0.1f + 0.15f * uniform((uint64_t)(3 + k), i));
      pags_plane(g, PAGS_SH + k)[i] = 3.0f * uniform((uint64_t)(6 + k), i) - 1.5f;
    }
    pags_plane(g, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(g, PAGS_OPACITY)[i] = 2.0f;
  }
}

/* A camera on a circle of radius 4 at height 0.5 that looks at the centre; OpenCV axes, world z up; before scaling
 * and offset. */
static pags_camera camera_of(int view, int views) {
  const double angle = 6.283185307179586 * view / views, eye[3] = {4.0 * cos(angle), 4.0 * sin(angle), 0.5};
  const double length = sqrt(16.25), x[3] = {-sin(angle), cos(angle), 0.0};
  const double z[3] = {-eye[0] / length, -eye[1] / length, -eye[2] / length};
  const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2], z[0] * x[1] - z[1] * x[0]};
  pags_camera c = {.width = HARD_VIEW_WIDTH,
                   .height = HARD_VIEW_HEIGHT,
                   .fx = HARD_VIEW_FOCAL,
                   .fy = HARD_VIEW_FOCAL,
                   .cx = HARD_VIEW_WIDTH / 2.0,
                   .cy = HARD_VIEW_HEIGHT / 2.0};
  for (int k = 0; k < 3; k++) {
    c.world_from_camera[4 * k] = x[k];
    c.world_from_camera[4 * k + 1] = y[k];
    c.world_from_camera[4 * k + 2] = z[k];
    c.world_from_camera[4 * k + 3] = eye[k];
  }
  return c;
}

static void save_level(const char *path, int level) {
  pags_image image;
  check(pags_image_create(&image, HARD_VIEW_WIDTH, HARD_VIEW_HEIGHT, 3, PAGS_U16));
  for (int i = 0; i < 3 * HARD_VIEW_WIDTH * HARD_VIEW_HEIGHT; i++)
    ((uint16_t *)image.data)[i] = (uint16_t)level;
  check(pags_image_save(path, &image));
  pags_image_destroy(&image);
}

static void save_view(pags_frame *frame, const pags_part *part, const pags_camera *camera, const char *path) {
  pags_frame_options options = pags_frame_options_default();
  pags_picture picture;
  pags_image image;
  check(pags_frame_render(frame, part, 1, camera, &options, NULL, NULL, &picture));
  check(pags_image_create(&image, HARD_VIEW_WIDTH, HARD_VIEW_HEIGHT, 3, PAGS_F32));
  for (int y = 0; y < HARD_VIEW_HEIGHT; y++)
    for (int x = 0; x < HARD_VIEW_WIDTH; x++)
      for (int c = 0; c < 3; c++)
        ((float *)image.data)[(y * HARD_VIEW_WIDTH + x) * 3 + c] = picture.rgb[c][y * picture.stride + x];
  check(pags_image_save(path, &image));
  pags_image_destroy(&image);
}

static void save_views(const pags_gaussians *truth, const char *name, const hard_data_options *o, int views) {
  pags_tasks *tasks = pags_tasks_create(1);
  pags_clusters clusters;
  pags_frame *frame;
  check(pags_clusters_create(&clusters, truth->count, 64));
  pags_clusters_update(&clusters, truth, 0, clusters.count);
  check(pags_frame_create(tasks, &frame));
  const pags_part part = {
      .gaussians = truth, .clusters = &clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  for (int v = 0; v < views; v++) {
    char file[NAME], view[24];
    const pags_camera camera = camera_of(v, views);
    snprintf(view, sizeof view, "view%d.png", v);
    join(file, name, view);
    if (o->level >= 0)
      save_level(hard_path(file), o->level);
    else
      save_view(frame, &part, &camera, hard_path(file));
  }
  pags_frame_destroy(frame);
  pags_clusters_destroy(&clusters);
  pags_tasks_destroy(tasks);
}

/* Writes transforms.json, whose poses are in OpenGL axes: y and z are flipped. */
static void save_transforms(const char *name, const hard_data_options *o, int views, double scale) {
  char file[NAME];
  join(file, name, "transforms.json");
  FILE *f = fopen(hard_path(file), "w");
  assert_non_null(f);
  fprintf(f,
          "{\"w\": %d, \"h\": %d, \"fl_x\": %g, \"fl_y\": %g, \"cx\": %g, \"cy\": %g, \"ply_file_path\": "
          "\"points.ply\", \"frames\": [",
          HARD_VIEW_WIDTH, HARD_VIEW_HEIGHT, HARD_VIEW_FOCAL, HARD_VIEW_FOCAL, HARD_VIEW_WIDTH / 2.0,
          HARD_VIEW_HEIGHT / 2.0);
  for (int v = 0; v < views; v++) {
    const pags_camera c = camera_of(v, views);
    fprintf(f, "%s{\"file_path\": \"view%d.png\", \"transform_matrix\": [", v ? ", " : "", v);
    for (int k = 0; k < 3; k++) {
      const double *r = c.world_from_camera + 4 * k;
      fprintf(f, "[%.17g, %.17g, %.17g, %.17g], ", r[0], -r[1], -r[2], scale * r[3] + o->offset[k]);
    }
    fprintf(f, "[0, 0, 0, 1]]}");
  }
  fprintf(f, "]}\n");
  fclose(f);
}

static void save_points(const char *name, const hard_data_options *o, const hard_points *points, double scale) {
  char file[NAME];
  join(file, name, "points.ply");
  FILE *f = fopen(hard_path(file), "w");
  assert_non_null(f);
  fprintf(f,
          "ply\nformat ascii 1.0\nelement vertex %lld\nproperty double x\nproperty double y\nproperty double z\n"
          "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
          (long long)points->count);
  for (int64_t i = 0; i < points->count; i++) {
    for (int k = 0; k < 3; k++)
      fprintf(f, "%.17g ", scale * (double)points->xyz[3 * i + k] + o->offset[k]);
    for (int k = 0; k < 3; k++)
      fprintf(f, "%d ", points->rgb ? points->rgb[3 * i + k] : 128);
    fprintf(f, "\n");
  }
  fclose(f);
}

pags_dataset *hard_data(const char *name, const hard_data_options *options) {
  const double scale = options->scale > 0 ? options->scale : 1;
  const int views = options->views > 0 ? options->views : HARD_VIEWS;
  pags_dataset_options reading = pags_dataset_options_default();
  pags_gaussians truth;
  pags_dataset *dataset = NULL;
  hard_points points = options->points;
  float own[3 * HARD_TRUTH];
  check(pags_make_dirs(hard_path(name)));
  hard_truth(&truth);
  for (int i = 0; i < 3 * HARD_TRUTH; i++)
    own[i] = pags_plane(&truth, PAGS_MEAN + i % 3)[i / 3];
  if (!points.xyz)
    points = (hard_points){HARD_TRUTH, own, NULL};
  save_views(&truth, name, options, views);
  save_transforms(name, options, views, scale);
  save_points(name, options, &points, scale);
  pags_gaussians_destroy(&truth);
  reading.split_every = 0;
  check(pags_dataset_open(hard_path(name), &reading, &dataset));
  return dataset;
}

/* ---- Runs ---- */

pags_train_config hard_config(int64_t steps) {
  pags_train_config c = pags_train_config_default();
  c.schedule.preset = PAGS_PRESET_PLAIN;
  c.schedule.iterations = steps;
  c.color.sh_degree = 1;
  c.schedule.quarter_until = c.schedule.half_until = 0;
  c.size_limit.max_gaussians = 600;
  c.density.densify_from = 0;
  c.density.densify_gradient = 1e-4;
  c.density.reset_every = 1000000000;
  c.picture.cluster_size = 16;
  return c;
}

static int stop_at_once(void *user, const pags_train_progress *progress) {
  (void)user;
  (void)progress;
  return 0;
}

/* Writes a checkpoint from which a run starts with given Gaussians: the checkpoint of a run's first step with its
 * Gaussians replaced and its step set to 0. */
static void save_start(const pags_dataset *dataset, const char *name, const pags_gaussians *start) {
  char file[NAME];
  pags_train_state state, fresh;
  uint64_t fingerprint;
  pags_gaussians copy;
  join(file, name, "checkpoint.pags");
  check(pags_checkpoint_load(hard_path(file), dataset, &state, &fingerprint));
  check(pags_gaussians_create_like(&copy, start->count, start));
  for (int p = 0; p < pags_plane_count(start->sh_degree); p++)
    memcpy(pags_plane(&copy, p), pags_plane(start, p), (size_t)start->count * sizeof(float));
  check(pags_state_create(&fresh, &state.schedule, state.stop, 1));
  fresh.cap = state.cap;
  check(pags_state_add_model(&fresh, -1, state.schedule.extent, &copy));
  check(pags_checkpoint_save(hard_path(file), NULL, false, &fresh, fingerprint));
  pags_state_destroy(&fresh);
  pags_state_destroy(&state);
}

pags_result hard_try(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                     const pags_gaussians *start, int threads, pags_train_options options, pags_train_result *result) {
  options.dataset = dataset;
  options.output = hard_path(name);
  options.tasks = pags_tasks_create(threads);
  options.log_every = 10;
  options.preview_every = 0;
  if (start) {
    pags_train_options first = options;
    first.progress = stop_at_once;
    first.overwrite = 1;
    check(pags_train(config, &first, result));
    save_start(dataset, name, start);
    options.resume = 1;
  }
  const pags_result code = pags_train(config, &options, result);
  pags_tasks_destroy(options.tasks);
  return code;
}

int64_t hard_check_scene(const char *name) {
  pags_scene scene;
  /* The scene loader refuses numbers that aren't finite and names them. */
  check(pags_scene_load(hard_path(name), &scene));
  int64_t count = 0;
  for (int64_t i = 0; i < scene.model_count; i++) {
    const pags_gaussians *g = &scene.models[i].gaussians;
    assert_int_equal(pags_gaussians_find_bad(g, NULL), 0);
    count += g->count;
  }
  pags_scene_destroy(&scene);
  return count;
}

pags_train_result hard_train(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                             const pags_gaussians *start) {
  pags_train_result result;
  check(hard_try(dataset, name, config, start, 2, pags_train_options_default(), &result));
  assert_true(result.finished);
  assert_int_equal(result.iterations, config->schedule.iterations);
  assert_true(isfinite(result.loss) && isfinite(result.psnr));
  hard_check_scene(name);
  return result;
}
