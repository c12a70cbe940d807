/* SPDX-License-Identifier: Apache-2.0 */
/* Compares the gradients by a part's pose, summed from the engine's row gradients, and by the Fourier terms of its
 * colour with finite differences of the oracle's picture. */
#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

enum { WIDTH = 72, HEIGHT = 56, PIXELS = WIDTH * HEIGHT, PARTS = 2, COUNT = 70 };

static int other_sh; /* 1: the parts have separate SH coefficients */

typedef struct pose_scene {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  pags_sky sky;
  reference_part parts[PARTS];
  double *weights;
} pose_scene;

static pose_scene create(uint64_t seed, int sh_degree) {
  pose_scene s = {.random = {seed}, .options = reference_options()};
  s.camera = reference_random_camera(&s.random, WIDTH, HEIGHT);
  s.sky = reference_random_sky(&s.random, 5);
  const reference_recipe recipe = reference_recipe_default();
  for (int p = 0; p < PARTS; p++) {
    s.parts[p] = reference_part_create(COUNT, sh_degree);
    s.parts[p].first_id = p * COUNT;
    reference_random_pose(&s.random, 5, s.parts[p].world_from_model);
    for (int64_t i = 0; i < COUNT; i++)
      reference_random_gaussian(&s.random, &recipe, &s.camera, &s.options, &s.parts[p], i);
    if (other_sh)
      reference_random_sh(&s.random, &s.parts[p]);
    frame_scene_round(&s.parts[p]);
  }
  s.weights = reference_alloc(5 * PIXELS, sizeof(double));
  return s;
}

static void destroy(pose_scene *s) {
  for (int p = 0; p < PARTS; p++)
    reference_part_destroy(&s->parts[p]);
  free(s->sky.texels);
  free(s->weights);
}

/* Computes pose * exp(increment) by Rodrigues' formula, also for large rotations. */
static void moved(const double pose[12], const double increment[6], double out[12]) {
  const double *w = increment, angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
  const double s = angle > 0 ? sin(angle) / angle : 1, c = angle > 0 ? (1 - cos(angle)) / (angle * angle) : 0.5;
  const double k[9] = {0, -w[2], w[1], w[2], 0, -w[0], -w[1], w[0], 0};
  double step[12] = {0};
  for (int row = 0; row < 3; row++) {
    for (int column = 0; column < 3; column++) {
      double square = 0;
      for (int j = 0; j < 3; j++)
        square += k[3 * row + j] * k[3 * j + column];
      step[4 * row + column] = (row == column) + s * k[3 * row + column] + c * square;
    }
    step[4 * row + 3] = increment[3 + row];
  }
  pags_rigid_multiply(pose, step, out);
}

static reference_picture render(pose_scene *s) {
  s->options.sky = s->sky.size > 0 ? &s->sky : NULL;
  return reference_render(s->parts, PARTS, &s->camera, &s->options);
}

/* Makes random loss weights on all planes, zero where a pixel is close to a different decision. */
static void make_weights(pose_scene *s) {
  reference_picture picture = render(s);
  for (int k = 0; k < PIXELS; k++) {
    for (int plane = 0; plane < 5; plane++) {
      const double value = (double)(float)reference_uniform(&s->random, -1, 1);
      s->weights[plane * PIXELS + k] = picture.margin[k] < 1e-3 || picture.depth_margin[k] < 1e-4 ? 0 : value;
    }
  }
  reference_picture_destroy(&picture);
}

static double loss(pose_scene *s) {
  reference_picture picture = render(s);
  double sum = 0;
  for (int k = 0; k < PIXELS; k++) {
    for (int channel = 0; channel < 3; channel++)
      sum += s->weights[channel * PIXELS + k] * picture.rgb[channel * PIXELS + k];
    sum += s->weights[3 * PIXELS + k] * picture.transmittance[k] + s->weights[4 * PIXELS + k] * picture.depth_sum[k];
  }
  reference_picture_destroy(&picture);
  return sum;
}

static double difference(pose_scene *s, int part, int axis) {
  const double step = 1e-7; /* too small to move an exponent by the margin that make_weights requires */
  double base[12], central[2];
  memcpy(base, s->parts[part].world_from_model, sizeof base);
  for (int k = 0; k < 2; k++) {
    double increment[6] = {0};
    increment[axis] = (k + 1) * step;
    moved(base, increment, s->parts[part].world_from_model);
    central[k] = loss(s);
    increment[axis] = -increment[axis];
    moved(base, increment, s->parts[part].world_from_model);
    central[k] -= loss(s);
  }
  memcpy(s->parts[part].world_from_model, base, sizeof base);
  return (8 * central[0] - central[1]) / (12 * step);
}

/* Adds up the pose gradient cluster by cluster, as a trainer does. */
static void engine_gradient(const frame_scene *scene, const frame_result *drawn, int part, double out[6]) {
  enum { SIZE = 128 };
  pags_part shown = scene->parts[part];
  shown.gaussians = &scene->gaussians[part];
  memset(out, 0, 6 * sizeof *out);
  for (int first = 0; first < COUNT; first += SIZE)
    pags_pose_gradient(drawn->parts[part].planes + first, COUNT, drawn->parts[part].plane_count, &shown, first,
                       COUNT - first < SIZE ? COUNT - first : SIZE, out);
}

static void check(uint64_t seed, int sh_degree) {
  pose_scene s = create(seed, sh_degree);
  make_weights(&s);
  pags_tasks *tasks = pags_tasks_create(2);
  pags_frame *frame;
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  frame_scene scene = frame_scene_create(s.parts, PARTS, 16, 0);
  const reference_picture_gradient gradient = {s.weights, s.weights + 3 * PIXELS, s.weights + 4 * PIXELS, NULL};
  frame_result drawn = frame_run(frame, &scene, &s.camera, &s.options, &gradient);
  for (int p = 0; p < PARTS; p++) {
    double got[6], want[6], norm = 0;
    engine_gradient(&scene, &drawn, p, got);
    for (int axis = 0; axis < 6; axis++) {
      want[axis] = difference(&s, p, axis);
      norm += want[axis] * want[axis] / 6;
    }
    for (int axis = 0; axis < 6; axis++) {
      const double error = fabs(got[axis] - want[axis]) / sqrt(norm);
      if (!(error < 3e-4))
        fail_msg("seed %d, part %d, axis %d: %.9g, should be %.9g", (int)seed, p, axis, got[axis], want[axis]);
    }
  }
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  destroy(&s);
}

/* Returns the loss's change by a motion of the camera, the inverse of exp(increment), about the origin to which
 * Gaussians are relative. Everything that the camera sees moves the opposite way. The scene has no sky, as skies don't
 * move. */
static double camera_difference(pose_scene *s, int axis) {
  const double step = 1e-7;
  const pags_camera base = s->camera;
  const double still[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  double central[2];
  for (int k = 0; k < 2; k++)
    for (int side = 1; side >= -1; side -= 2) {
      double increment[6] = {0}, motion[12];
      increment[axis] = -side * (k + 1) * step;
      moved(still, increment, motion);
      s->camera = base;
      double *m = s->camera.world_from_camera;
      for (int i = 0; i < 3; i++)
        m[4 * i + 3] -= s->options.origin[i];
      pags_rigid_multiply(motion, m, m);
      for (int i = 0; i < 3; i++)
        m[4 * i + 3] += s->options.origin[i];
      central[k] = side > 0 ? loss(s) : central[k] - loss(s);
    }
  s->camera = base;
  return (8 * central[0] - central[1]) / (12 * step);
}

static void test_camera(void **state) {
  (void)state;
  for (uint64_t seed = 71; seed <= 73; seed++) {
    pose_scene s = create(seed, (int)(seed % 4));
    s.sky.size = 0;
    make_weights(&s);
    pags_tasks *tasks = pags_tasks_create(2);
    pags_frame *frame;
    assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
    frame_scene scene = frame_scene_create(s.parts, PARTS, 16, 0);
    const reference_picture_gradient gradient = {s.weights, s.weights + 3 * PIXELS, s.weights + 4 * PIXELS, NULL};
    frame_result drawn = frame_run(frame, &scene, &s.camera, &s.options, &gradient);
    double got[6] = {0}, want[6], turns = 0, moves = 0;
    for (int p = 0; p < PARTS; p++) {
      double own[6];
      engine_gradient(&scene, &drawn, p, own);
      pags_pose_gradient_by_world(s.parts[p].world_from_model, own, got);
    }
    for (int axis = 0; axis < 6; axis++) {
      want[axis] = camera_difference(&s, axis);
      *(axis < 3 ? &turns : &moves) += want[axis] * want[axis] / 3;
    }
    for (int axis = 0; axis < 6; axis++) {
      const double error = fabs(got[axis] - want[axis]) / sqrt(axis < 3 ? turns : moves);
      if (!(error < 3e-4))
        fail_msg("seed %d, axis %d: %.9g, should be %.9g", (int)seed, axis, got[axis], want[axis]);
    }
    frame_result_destroy(&drawn);
    frame_scene_destroy(&scene);
    pags_frame_destroy(frame);
    pags_tasks_destroy(tasks);
    destroy(&s);
  }
}

static void test_every_degree(void **state) {
  (void)state;
  for (int degree = 0; degree <= 3; degree++) {
    for (uint64_t seed = 1; seed <= 2; seed++)
      check(10 * (uint64_t)degree + seed, degree);
  }
}

enum { TERM_DEGREE = 2, TERMS = PAGS_FOURIER_PLANES * (TERM_DEGREE + 1) * (TERM_DEGREE + 1) };

/* The oracle's SH coefficients at phase u of the track, in double: those of the rows plus their series. */
static void evaluate(reference_part *part, const double *terms, double u) {
  const double a = 2 * 3.14159265358979323846 * u, wave[4] = {sin(a), cos(a), sin(2 * a), cos(2 * a)};
  for (int c = 0; c < TERMS / PAGS_FOURIER_PLANES; c++)
    for (int channel = 0; channel < 3; channel++)
      for (int64_t i = 0; i < COUNT; i++) {
        double *const sum = &part->sh[(3 * c + channel) * COUNT + i];
        *sum = part->planes[(PAGS_SH + 3 * c + channel) * COUNT + i];
        for (int k = 0; k < 4; k++)
          *sum += wave[k] * terms[(12 * c + 3 * k + channel) * COUNT + i];
      }
}

/* The loss's derivatives by the Fourier terms of all SH coefficients: those of the engine's picture of its own
 * evaluation against differences of the oracle's. */
static void test_fourier_terms(void **state) {
  (void)state;
  enum { SAMPLES = 60 };
  const double u = 0.37, step = 1e-5;
  double basis[5];
  pags_tasks *tasks = pags_tasks_create(2);
  pags_frame *frame;
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  other_sh = 1;
  pose_scene s = create(60, TERM_DEGREE);
  frame_scene scene = frame_scene_create(s.parts, PARTS, 16, 0);
  double *terms[PARTS];
  pags_fourier_basis(u, basis);
  for (int p = 0; p < PARTS; p++) {
    pags_gaussians *const g = &scene.gaussians[p];
    terms[p] = reference_alloc(TERMS * COUNT, sizeof(double));
    assert_int_equal(pags_gaussians_add_fourier(g, TERM_DEGREE), PAGS_OK);
    for (int t = 0; t < TERMS; t++)
      for (int64_t i = 0; i < COUNT; i++)
        terms[p][t * COUNT + i] = (double)(g->fourier[t * g->stride + i] = 0.3F * (float)reference_normal(&s.random));
    evaluate(&s.parts[p], terms[p], u);
    pags_fourier_colour(g, basis, 0, COUNT, scene.sh_values[p]);
  }
  make_weights(&s);
  const reference_picture_gradient gradient = {s.weights, s.weights + 3 * PIXELS, s.weights + 4 * PIXELS, NULL};
  frame_result drawn = frame_run(frame, &scene, &s.camera, &s.options, &gradient);
  int compared = 0;
  for (int p = 0; p < PARTS; p++) {
    float *const got = reference_alloc(TERMS * COUNT, sizeof(float));
    pags_fourier_gradient(basis, drawn.parts[p].planes + PAGS_SH * COUNT, COUNT, TERMS, got);
    for (int n = 0; n < SAMPLES; n++) {
      const int at = (int)reference_uniform(&s.random, 0, TERMS * COUNT);
      double central = 0;
      for (int side = 1; side >= -1; side -= 2) {
        terms[p][at] += side * step;
        evaluate(&s.parts[p], terms[p], u);
        central += side * loss(&s) / (2 * step);
        terms[p][at] -= side * step;
      }
      evaluate(&s.parts[p], terms[p], u);
      compared += central != 0;
      if (!(fabs((double)got[at] - central) < 1e-4 * (1 + fabs(central))))
        fail_msg("part %d, plane %d of row %d: %.9g, should be %.9g", p, at / COUNT, at % COUNT, (double)got[at],
                 central);
    }
    free(got);
  }
  assert_true(compared > SAMPLES / 2);
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  for (int p = 0; p < PARTS; p++)
    free(terms[p]);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  destroy(&s);
  other_sh = 0;
}

/* The parts have SH coefficients in place of the Gaussians'. */
static void test_other_sh(void **state) {
  (void)state;
  other_sh = 1;
  check(50, 2);
  other_sh = 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_every_degree),
      cmocka_unit_test(test_other_sh),
      cmocka_unit_test(test_camera),
      cmocka_unit_test(test_fourier_terms),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
