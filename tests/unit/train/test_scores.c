/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the scores by which pruning ranks Gaussians. A frame computes them; they are compared with the
 * double-precision oracle, and the oracle with finite differences. Also tests the semantic score S_sem in a run's
 * rows. */
#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "train/score_pass.h"

enum { WIDTH = 101, HEIGHT = 67, PIXELS = WIDTH * HEIGHT, STRIDE = 112, ROWS = 80, COUNT = 600 };

typedef struct sums { /* sums of each Gaussian, part after part */
  double seen[COUNT], critical[COUNT], squared[COUNT];
} sums;

typedef struct fixture {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
  float counted[STRIDE * ROWS], critical[STRIDE * ROWS];
} fixture;

static void begin(fixture *f, int64_t count) {
  *f = (fixture){.random = {5}, .options = reference_options()};
  f->options.background[0] = 0.25f;
  f->options.background[1] = 0.5f;
  f->camera = reference_random_camera(&f->random, WIDTH, HEIGHT);
  f->part = reference_part_create(count, 3);
  const reference_recipe recipe = reference_recipe_default();
  for (int64_t i = 0; i < count; i++)
    reference_random_gaussian(&f->random, &recipe, &f->camera, &f->options, &f->part, i);
  frame_scene_round(&f->part);
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      f->counted[y * STRIDE + x] = 1.0f;
      f->critical[y * STRIDE + x] = x < WIDTH / 3 ? 1.0f : 0.0f;
    }
}

static void end(fixture *f) {
  reference_part_destroy(&f->part);
}

static void collect(void *user, const pags_cluster_score *c, int worker) {
  sums *s = user;
  (void)worker;
  for (int i = 0; i < c->count; i++) {
    s->seen[c->first + i] = c->seen[i];
    s->critical[c->first + i] = c->critical[i];
    s->squared[c->first + i] = c->squared[i];
  }
}

static void score(const fixture *f, int threads, int cluster_size, int overlap, sums *out) {
  pags_tasks *tasks = pags_tasks_create(threads);
  pags_frame *frame;
  pags_picture picture;
  pags_frame_options options = f->options;
  frame_scene scene = frame_scene_create(&f->part, 1, cluster_size, 0);
  pags_score_planes planes = {.counted = f->counted, .critical = f->critical, .overlap = overlap};
  options.keep_for_backward = 1;
  *out = (sums){{0}, {0}, {0}};
  /* `scene` was returned by value, so the pointer into it must be set again. */
  scene.parts[0].gaussians = &scene.gaussians[0];
  scene.parts[0].clusters = &scene.clusters[0];
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, scene.parts, 1, &f->camera, &options, NULL, NULL, &picture), PAGS_OK);
  assert_int_equal(picture.stride, STRIDE);
  assert_int_equal(pags_frame_scores(frame, &planes, collect, out), PAGS_OK);
  pags_frame_destroy(frame);
  frame_scene_destroy(&scene);
  pags_tasks_destroy(tasks);
}

/* Returns the derivative of L by the Gaussian's falloff G for one contribution; L is the sum of the pixel's channels,
 * `behind` the colour composited behind it. */
static double by_value(const reference_contribution *c, const reference_splat *splat, double behind) {
  double alpha = fmin(REFERENCE_ALPHA_CAP, c->alpha_raw), opacity = c->alpha_raw / c->falloff;
  double value = splat->colour[0] + splat->colour[1] + splat->colour[2];
  return opacity * (c->transmittance * value - behind / (1 - alpha));
}

static double *background_sums(const fixture *f, const reference_picture *picture) {
  double *behind = reference_alloc(PIXELS, sizeof *behind);
  for (int64_t pixel = 0; pixel < PIXELS; pixel++) {
    double colour[3], margin = INFINITY;
    reference_behind(&f->camera, &f->options, pixel, colour, &margin);
    behind[pixel] = picture->transmittance[pixel] * (colour[0] + colour[1] + colour[2]);
  }
  return behind;
}

static void score_plainly(const fixture *f, const reference_picture *picture, sums *out) {
  double *behind = background_sums(f, picture);
  *out = (sums){{0}, {0}, {0}};
  for (int64_t k = picture->contribution_count - 1; k >= 0; k--) {
    const reference_contribution *c = &picture->contributions[k];
    const reference_splat *splat = &picture->splats[c->gaussian];
    int64_t at = c->pixel / WIDTH * STRIDE + c->pixel % WIDTH;
    double weight = fmin(REFERENCE_ALPHA_CAP, c->alpha_raw) * c->transmittance, counted = (double)f->counted[at];
    double derivative = by_value(c, splat, behind[c->pixel]);
    out->seen[c->gaussian] += counted * weight;
    out->critical[c->gaussian] += counted * weight * (double)f->critical[at];
    out->squared[c->gaussian] += counted * derivative * derivative;
    behind[c->pixel] += weight * (splat->colour[0] + splat->colour[1] + splat->colour[2]);
  }
  free(behind);
}

/* Leaves out pixels at which float rounding may decide a threshold or a depth order otherwise than double. */
static void leave_out_doubtful(fixture *f, const reference_picture *picture) {
  int64_t left_out = 0;
  for (int64_t pixel = 0; pixel < PIXELS; pixel++)
    if (picture->margin[pixel] < 1e-4 || picture->depth_margin[pixel] < 1e-6) {
      f->counted[pixel / WIDTH * STRIDE + pixel % WIDTH] = 0.0f;
      left_out++;
    }
  assert_true(left_out < PIXELS / 2);
}

static void sums_match_the_oracle(void **unused) {
  (void)unused;
  fixture f;
  static sums got, want;
  begin(&f, COUNT);
  reference_picture picture = reference_render(&f.part, 1, &f.camera, &f.options);
  leave_out_doubtful(&f, &picture);
  score_plainly(&f, &picture, &want);
  score(&f, 2, 64, 0, &got);
  double total = 0.0, critical = 0.0;
  for (int i = 0; i < COUNT; i++) {
    assert_true(fabs(got.seen[i] - want.seen[i]) <= 1e-4 * want.seen[i] + 1e-5);
    assert_true(fabs(got.critical[i] - want.critical[i]) <= 1e-4 * want.seen[i] + 1e-5);
    assert_true(fabs(got.squared[i] - want.squared[i]) <= 2e-3 * want.squared[i] + 1e-4);
    total += want.seen[i];
    critical += want.critical[i];
  }
  /* Critical and other Gaussians both have a substantial share. */
  assert_true(critical > 0.1 * total && critical < 0.9 * total);
  reference_picture_destroy(&picture);
  end(&f);
}

/* The sum of a pixel's channels when the falloff of one contribution is increased by `hair`, for finite differences;
 * `list` is front to back. */
static double channel_sum(const reference_picture *picture, const int64_t *list, int count, int raised, double hair,
                          double background) {
  double sum = 0.0, through = 1.0;
  for (int i = 0; i < count; i++) {
    const reference_contribution *c = &picture->contributions[list[i]];
    const reference_splat *splat = &picture->splats[c->gaussian];
    double opacity = c->alpha_raw / c->falloff;
    double alpha = fmin(REFERENCE_ALPHA_CAP, c->alpha_raw) + (i == raised ? opacity * hair : 0.0);
    sum += through * alpha * (splat->colour[0] + splat->colour[1] + splat->colour[2]);
    through *= 1 - alpha;
  }
  return sum + through * background;
}

enum { MOST_LAYERS = 256 };

static int list_pixel(const reference_picture *picture, int64_t pixel, int64_t *list) {
  int count = 0;
  for (int64_t k = 0; k < picture->contribution_count && count < MOST_LAYERS; k++)
    if (picture->contributions[k].pixel == pixel)
      list[count++] = k;
  return count;
}

static void the_oracle_s_derivative_matches_differences(void **unused) {
  (void)unused;
  fixture f;
  begin(&f, COUNT);
  reference_picture picture = reference_render(&f.part, 1, &f.camera, &f.options);
  double *behind = background_sums(&f, &picture);
  int tried = 0;
  for (int64_t pixel = 0; pixel < PIXELS; pixel += 97) {
    int64_t list[MOST_LAYERS];
    int count = list_pixel(&picture, pixel, list);
    double sum = behind[pixel], rest = behind[pixel] / picture.transmittance[pixel];
    for (int i = count; i-- > 0; tried++) {
      const reference_contribution *c = &picture.contributions[list[i]];
      const reference_splat *splat = &picture.splats[c->gaussian];
      const double hair = 1e-6;
      double slope =
          (channel_sum(&picture, list, count, i, hair, rest) - channel_sum(&picture, list, count, i, -hair, rest)) /
          (2 * hair);
      assert_true(fabs(by_value(c, splat, sum) - slope) < 1e-6);
      sum += fmin(REFERENCE_ALPHA_CAP, c->alpha_raw) * c->transmittance *
             (splat->colour[0] + splat->colour[1] + splat->colour[2]);
    }
  }
  assert_true(tried > 200);
  free(behind);
  reference_picture_destroy(&picture);
  end(&f);
}

static void threads_and_clusters_change_nothing(void **unused) {
  (void)unused;
  fixture f;
  static sums first, other;
  begin(&f, COUNT);
  for (int overlap = 0; overlap < 2; overlap++) {
    score(&f, 1, 64, overlap, &first);
    for (int threads = 2; threads <= 7; threads++) {
      score(&f, threads, threads % 2 ? 16 : 64, overlap, &other);
      assert_memory_equal(&first, &other, sizeof first);
    }
  }
  end(&f);
}

static void place(fixture *f, int64_t i, double z, double sigma, double logit) {
  const double values[11] = {0, 0, z, log(sigma), log(sigma), log(sigma), 1, 0, 0, 0, logit};
  for (int plane = 0; plane < 11; plane++)
    f->part.planes[plane * f->part.count + i] = values[plane];
}

/* A car of 12 layers stands in front of a wall that looks equally large. The critical mask covers the pixels where
 * the car is almost opaque. The wall must get almost no critical weight. */
static void a_wall_behind_a_car_gets_no_credit(void **unused) {
  (void)unused;
  enum { LAYERS = 12 };
  const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  fixture f;
  static sums got;
  begin(&f, LAYERS + 1);
  memcpy(f.camera.world_from_camera, identity, sizeof identity);
  for (int i = 0; i < LAYERS; i++)
    place(&f, i, 4.0 + 0.01 * i, 0.5, 8.0);
  place(&f, LAYERS, 8.0, 1.0, 8.0);
  double edge = 1.5 * 0.5 * f.camera.fx / 4.0; /* at this radius a layer's alpha is 0.32 */
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++)
      f.critical[y * STRIDE + x] = hypot(x + 0.5 - f.camera.cx, y + 0.5 - f.camera.cy) < edge;
  score(&f, 1, 64, 0, &got);
  assert_true(got.critical[0] > 0.5 * got.seen[0]);
  assert_true(got.seen[LAYERS] > 1.0);
  assert_true(got.critical[LAYERS] < 0.05 * got.seen[LAYERS]);
  score(&f, 1, 64, 1, &got); /* a score by overlap alone gives the wall critical weight */
  assert_true(got.critical[LAYERS] > 0.2 * got.seen[LAYERS]);
  end(&f);
}

/* ---- Writing S_sem ---- */

static void fill_state(pags_train_state *s) {
  pags_gaussians g;
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PLAIN;
  config.color.sh_degree = 0;
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 4);
  assert_int_equal(pags_state_create(s, &schedule, 100, 2), PAGS_OK);
  for (int m = 0; m < 2; m++) {
    assert_int_equal(pags_gaussians_create(&g, 3, 0), PAGS_OK);
    assert_int_equal(pags_gaussians_add_s_sem(&g), PAGS_OK);
    for (int i = 0; i < 3; i++)
      g.s_sem[i] = 0.125f;
    assert_int_equal(pags_state_add_model(s, m - 1, 1.0, &g), PAGS_OK);
  }
}

static void unseen_gaussians_keep_their_priority(void **unused) {
  (void)unused;
  double seen[6] = {2, 0, 4, 0, 1, 1}, critical[6] = {1, 0, 0, 0, 1.0000000001, 0.25};
  pags_score_pass scores = {.count = 6, .seen = seen, .critical = critical};
  pags_train_state s;
  fill_state(&s);
  pags_score_pass_write_s_sem(&s, &scores);
  const float want[6] = {0.5f, 0.125f, 0.0f, 0.125f, 1.0f, 0.25f};
  assert_memory_equal(s.models[0].gaussians.s_sem, want, 3 * sizeof *want);
  assert_memory_equal(s.models[1].gaussians.s_sem, want + 3, 3 * sizeof *want);
  pags_state_destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(sums_match_the_oracle),
      cmocka_unit_test(the_oracle_s_derivative_matches_differences),
      cmocka_unit_test(threads_and_clusters_change_nothing),
      cmocka_unit_test(a_wall_behind_a_car_gets_no_credit),
      cmocka_unit_test(unseen_gaussians_keep_their_priority),
  };
  return cmocka_run_group_tests_name("scores", tests, NULL, NULL);
}
