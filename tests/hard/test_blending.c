/* SPDX-License-Identifier: Apache-2.0 */
/* Hard blending (cases 1, 8, 15, 26, 30 of docs/lab/numerics.md): a million Gaussians in one pixel, opaque stacks,
 * dropout of every Gaussian, colours and exposures that aren't finite. */
#include "hard/hard.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { MILLION = 1000000 };
static const double c0 = 0.28209479177387814;

typedef struct pile { /* a million rows on one pixel, degree 0 */
  pags_gaussians g;
  pags_clusters clusters;
  pags_tasks *tasks;
  pags_frame *frame;
  pags_picture picture;
  float *weights;
  double *by_dc; /* gradient of the red constant term, per row */
} pile;

static void receive(void *user, const pags_cluster_gradient *from, int worker) {
  pile *p = user;
  (void)worker;
  for (int i = 0; i < from->count; i++)
    p->by_dc[from->first + i] = (double)from->data[PAGS_SH * from->stride + i];
}

/* Makes a pile of red Gaussians on black over the centre pixel of a 16 x 16 picture, `spacing` metres apart and at
 * least 1 m away. */
static void pile_up(pile *p, float logit, double spacing) {
  const pags_camera camera = {.width = 16,
                              .height = 16,
                              .fx = 16,
                              .fy = 16,
                              .cx = 8.5,
                              .cy = 8.5,
                              .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  pags_frame_options options = pags_frame_options_default();
  int64_t bad = -1;
  *p = (pile){.tasks = pags_tasks_create(2)};
  assert_int_equal(pags_gaussians_create(&p->g, MILLION, 0), PAGS_OK);
  for (int64_t i = 0; i < MILLION; i++) {
    pags_plane(&p->g, PAGS_MEAN + 2)[i] = (float)(1 + spacing * (double)i);
    for (int k = 0; k < 3; k++) {
      pags_plane(&p->g, PAGS_SCALE + k)[i] = -9.0f;
      pags_plane(&p->g, PAGS_SH + k)[i] = k == 0 ? (float)(0.5 / c0) : (float)(-0.5 / c0);
    }
    pags_plane(&p->g, PAGS_ROTATION)[i] = 1.0f;
    pags_plane(&p->g, PAGS_OPACITY)[i] = logit;
  }
  assert_int_equal(pags_clusters_create(&p->clusters, MILLION, 64), PAGS_OK);
  pags_clusters_update(&p->clusters, &p->g, 0, p->clusters.count);
  assert_int_equal(pags_frame_create(p->tasks, &p->frame), PAGS_OK);
  const pags_part part = {
      .gaussians = &p->g, .clusters = &p->clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  options.keep_for_backward = 1;
  assert_int_equal(pags_frame_render(p->frame, &part, 1, &camera, &options, NULL, NULL, &p->picture), PAGS_OK);
  assert_int_equal(pags_frame_stats_get(p->frame)->pairs_binned, MILLION);
  p->weights = reference_alloc(16 * 16, sizeof(float));
  p->weights[8 * 16 + 8] = 1;
  float *const zeros = reference_alloc(16 * 16, sizeof(float));
  p->by_dc = reference_alloc(MILLION, sizeof(double));
  const pags_picture_gradient gradient = {.rgb = {p->weights, zeros, zeros}};
  assert_int_equal(pags_frame_backward(p->frame, &gradient, receive, p, &bad), PAGS_OK);
  assert_int_equal(bad, 0);
  free(zeros);
}

static void pile_destroy(pile *p) {
  free(p->weights);
  free(p->by_dc);
  pags_frame_destroy(p->frame);
  pags_clusters_destroy(&p->clusters);
  pags_gaussians_destroy(&p->g);
  pags_tasks_destroy(p->tasks);
}

/* Compares with the closed form: with opacity o at every pixel centre T_n = (1 - o)^n, the pixel stops before T would
 * fall below 1e-4, its red is 1 - T, and the derivative by the n-th constant term is c0 o T_n. Rows are blended in
 * their order, by depth or, at equal depth, by index. */
static void check_pile(const char *what, float logit, double spacing) {
  pile p;
  pile_up(&p, logit, spacing);
  const double o = fmin((double)0.99f, 1 / (1 + exp(-(double)logit)));
  double t = 1, worst = 0;
  int64_t n = 0;
  for (; n < MILLION && (t * (1 - o)) >= 1e-4; n++) {
    worst = fmax(worst, fabs(p.by_dc[n] / (c0 * o * t) - 1));
    t *= 1 - o;
  }
  const int64_t at = 8 * p.picture.stride + 8;
  const double red = fabs((double)p.picture.rgb[0][at] - (1 - t)),
               left = fabs((double)p.picture.transmittance[at] / t - 1);
  print_message("  %-40s %lld blended; colour %.1e, T %.1e and gradient %.1e relative\n", what, (long long)n, red, left,
                worst);
  assert_true(red < 1e-5 && left < 1e-3 && worst < 1e-3);
  /* Where T reaches 1e-4, one row more or less may be drawn. */
  for (int64_t i = n + 1; i < MILLION; i++)
    assert_true(p.by_dc[i] == 0);
  pile_destroy(&p);
}

static void a_million_in_one_pixel(void **state) {
  (void)state;
  check_pile("a million of 0.005, one behind another", -5.2933048f, 1e-5);
  if (hard_leaves_out())
    return;
  check_pile("a million of 0.5, all at the same depth", 0.0f, 0);
  check_pile("a million of 1 - 1e-7", 16.1180956f, 1e-5);
}

/* #15: T falls from 1 to 1e-4 through alphas of all sizes, some of them capped; the transmittances recovered in the
 * backward pass give the oracle's gradients. */
static void deep_stacks(void **state) {
  (void)state;
  enum { ROWS = 120 };
  static const double logits[] = {-3, 0, 4.59511985013459, 4.7, 9, 16.118, 20, 25};
  for (int k = 0; k < 8; k++) {
    char what[48];
    hard_scene s = hard_scene_create(30 + (uint64_t)k, ROWS);
    for (int i = 0; i < ROWS; i++)
      hard_put(&s, i, 0.02 * reference_normal(&s.random), 0.02 * reference_normal(&s.random), 1 + 0.01 * i, 0.2,
               logits[k]);
    snprintf(what, sizeof what, "stacks of logit %g", logits[k]);
    hard_expect(what, &s, 2e-5, 2e-3);
    hard_scene_destroy(&s);
  }
}

/* #30: with every Gaussian dropped the picture is the background and gradients are zero; with dropout factors that
 * raise opacities beyond 1, alpha stays below its cap. */
static void dropped(void **state) {
  (void)state;
  enum { ROWS = 60 };
  hard_scene s = hard_scene_create(40, ROWS);
  s.part.factor = reference_alloc(ROWS, sizeof(double));
  double *weights = reference_alloc(5 * HARD_PIXELS, sizeof(double));
  for (int k = 0; k < 5 * HARD_PIXELS; k++)
    weights[k] = reference_uniform(&s.random, -1, 1);
  frame_result none = hard_run(&s, weights);
  for (int k = 0; k < HARD_PIXELS; k++)
    assert_true(none.transmittance[k] == 1 && none.rgb[k] == s.options.background[0]);
  for (int64_t k = 0; k < ROWS * PAGS_MAX_PLANES; k++)
    assert_true(none.parts[0].planes[k] == 0);
  frame_result_destroy(&none);
  /* The largest possible factor is 1 / (1 - 0.9), for a dropout_gamma of 0.9. */
  for (int i = 0; i < ROWS; i++) {
    s.part.factor[i] = i % 3 == 0 ? 0 : 10;
    *hard_at(&s, PAGS_OPACITY, i) = 2;
  }
  frame_result boosted = hard_run(&s, weights);
  double least = 1;
  for (int k = 0; k < HARD_PIXELS; k++)
    least = fmin(least, (double)boosted.transmittance[k]);
  assert_true(least >= 0.9999e-4 && least < 0.011);
  frame_result_destroy(&boosted);
  free(weights);
  hard_scene_destroy(&s);
}

/* #26: colours far below 0, huge, and not finite: pixels hold no NaN and no negative values, and the gradient through
 * the clamp is 0. */
static void bad_colours(void **state) {
  (void)state;
  enum { ROWS = 48 };
  hard_scene s = hard_scene_create(41, ROWS);
  for (int i = 0; i < 24; i++)
    for (int p = PAGS_SH; p < PAGS_SH + 3; p++)
      *hard_at(&s, p, i) = i % 2 ? -1e30 : -5;
  hard_expect("colours below 0", &s, 1e-5, 1e-3);
  for (int i = 0; i < 24; i++)
    *hard_at(&s, PAGS_SH + i % 48, i) = i % 3 == 0 ? NAN : i % 3 == 1 ? INFINITY : -INFINITY;
  frame_result result = hard_run(&s, NULL);
  frame_result_destroy(&result);
  hard_scene_destroy(&s);
}

/* Tests exposure gains of 0 and 65535, and such offsets, on the finished picture. */
static void exposures(void **state) {
  (void)state;
  hard_scene s = hard_scene_create(42, 60);
  frame_result plain = hard_run(&s, NULL);
  assert_true(pags_frame_options_expose(&s.options, (double[]){0, 65535, 1}, (double[]){0, 0, 65535}));
  frame_result shown = hard_run(&s, NULL);
  double worst = 0;
  for (int k = 0; k < HARD_PIXELS; k++) {
    assert_true(shown.rgb[k] == 0);
    worst = fmax(worst, fabs((double)shown.rgb[HARD_PIXELS + k] / (65535 * (double)plain.rgb[HARD_PIXELS + k]) - 1));
    worst = fmax(worst,
                 fabs((double)shown.rgb[2 * HARD_PIXELS + k] / (65535 + (double)plain.rgb[2 * HARD_PIXELS + k]) - 1));
  }
  print_message("  exposures of 0 and 65535                 %.1e relative\n", worst);
  assert_true(worst < 1e-6);
  frame_result_destroy(&plain);
  frame_result_destroy(&shown);
  hard_scene_destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_million_in_one_pixel),
      cmocka_unit_test(deep_stacks),
      cmocka_unit_test(dropped),
      cmocka_unit_test(bad_colours),
      cmocka_unit_test(exposures),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
