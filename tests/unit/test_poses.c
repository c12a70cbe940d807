/* Optimised poses and exposures: their gradients, their steps, and what is held fixed. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "train/exposure.h"
#include "train/tracks.h"

enum { WIDTH = 21, HEIGHT = 9, STRIDE = 32, FLOATS = STRIDE * HEIGHT };

static float noise(uint64_t purpose, int i) {
  return (float)pags_rng_uniform(5, purpose, (uint64_t)i);
}

/* Loss = sum of weight * (gain x + offset): its gradients are sums that can be written down. */
static void exposure_gradient_is_that_of_its_sums(void **unused) {
  (void)unused;
  static float x[3][FLOATS], g[3][FLOATS], out[3][FLOATS];
  float *planes[3] = {g[0], g[1], g[2]}, *exposed[3] = {out[0], out[1], out[2]};
  pags_exposure e = {.value = {1.2, 0.9, 1.05, 0.03, -0.02, 0.0}};
  pags_picture picture = {.width = WIDTH, .height = HEIGHT, .stride = STRIDE, .rgb = {x[0], x[1], x[2]}};
  double wanted[6] = {0.0}, found[6];
  pags_tasks *tasks = pags_tasks_create(2);
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < HEIGHT; y++)
      for (int i = 0; i < WIDTH; i++) {
        int at = y * STRIDE + i;
        x[c][at] = noise((uint64_t)c, at);
        g[c][at] = noise(3 + (uint64_t)c, at) - 0.5f;
        wanted[c] += (double)g[c][at] * (double)x[c][at];
        wanted[3 + c] += (double)g[c][at];
      }
  float before = g[1][3 * STRIDE + 7];
  assert_int_equal(pags_exposure_apply(&e, &picture, tasks, exposed), PAGS_OK);
  assert_true(fabsf(out[1][40] - (0.9f * x[1][40] - 0.02f)) < 1e-6f);
  assert_int_equal(pags_exposure_backward(&e, &picture, tasks, planes, found), PAGS_OK);
  for (int k = 0; k < 6; k++)
    assert_true(fabs(found[k] - wanted[k]) < 1e-5);
  assert_true(fabsf(g[1][3 * STRIDE + 7] - 0.9f * before) < 1e-6f);
  pags_tasks_destroy(tasks);
}

static pags_tracks one_track(void) {
  pags_tracks t = {.count = 1, .objects = calloc(1, sizeof *t.objects), .moments = calloc(1, sizeof *t.moments)};
  t.objects[0] = (pags_object){.knot_count = 2, .knots = calloc(2, sizeof(pags_knot))};
  t.moments[0] = calloc(2, sizeof(pags_track_moments));
  t.objects[0].knots[1].frame = 4;
  return t;
}

/* The loss |p - target|^2 / 2 of a point that the box carries, and its gradient by the perturbation. */
static void gradient_of(const pags_knot *k, const double point[3], const double target[3], double g[6]) {
  double m[12], error[3], local[3];
  pags_increment_matrix(k->rotation, k->translation, m);
  for (int i = 0; i < 3; i++)
    error[i] = m[4 * i] * point[0] + m[4 * i + 1] * point[1] + m[4 * i + 2] * point[2] + m[4 * i + 3] - target[i];
  for (int i = 0; i < 3; i++) /* back into the frame that is perturbed */
    local[i] = m[i] * error[0] + m[4 + i] * error[1] + m[8 + i] * error[2];
  for (int i = 0; i < 3; i++) {
    int a = (i + 1) % 3, b = (i + 2) % 3;
    g[i] += point[a] * local[b] - point[b] * local[a];
    g[3 + i] += local[i];
  }
}

static void a_pose_is_found(void **unused) {
  (void)unused;
  static const double points[4][3] = {{2, 0, 0}, {0, 1, 0}, {0, 0, 1}, {-2, 1, 0.5}};
  pags_train_config config = pags_train_config_default();
  config.iterations = 2000;
  pags_schedule schedule = pags_schedule_make(&config, 1.0, 10);
  pags_tracks tracks = one_track();
  pags_knot *knot = &tracks.objects[0].knots[1], truth = {.rotation = {0, 0, 0.1}, .translation = {0.3, -0.2, 0.05}};
  double m[12];
  pags_increment_matrix(truth.rotation, truth.translation, m);
  for (int step = 1; step <= 600; step++) {
    double g[6] = {0.0};
    for (int p = 0; p < 4; p++) {
      double target[3];
      for (int i = 0; i < 3; i++)
        target[i] = m[4 * i] * points[p][0] + m[4 * i + 1] * points[p][1] + m[4 * i + 2] * points[p][2] + m[4 * i + 3];
      gradient_of(knot, points[p], target, g);
    }
    pags_tracks_update(&tracks, 0, pags_tracks_knot(&tracks.objects[0], 4), g, &schedule, step);
  }
  for (int i = 0; i < 3; i++) {
    assert_true(fabs(knot->rotation[i] - truth.rotation[i]) < 0.005);
    assert_true(fabs(knot->translation[i] - truth.translation[i]) < 0.01);
    assert_true(tracks.objects[0].knots[0].translation[i] == 0.0); /* the other knot stays */
  }
  double bad[6] = {NAN};
  pags_knot kept = *knot;
  pags_tracks_update(&tracks, 0, 1, bad, &schedule, 601);
  assert_memory_equal(&kept, knot, sizeof kept);
  assert_int_equal(pags_tracks_knot(&tracks.objects[0], 3), -1);
  pags_tracks_destroy(&tracks);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(exposure_gradient_is_that_of_its_sums),
      cmocka_unit_test(a_pose_is_found),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
