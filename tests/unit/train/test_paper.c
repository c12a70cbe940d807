/* SPDX-License-Identifier: Apache-2.0 */
/* Tests that preset paper follows the equations of the paper of PAGS (arXiv:2510.12282), section 2.2, on a small
 * street. The oracles draw pictures with one Gaussian alone or fainter; none uses scores. Equations 2 and 3, of
 * dropout, are tested in test_dropout.c, the steps and rates of prunes in test_prune.c. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pags/scene.h>
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "base/sort.h"
#include "dataset/internal.h"
#include "small_street.h"
#include "train/config.h"
#include "train/prune.h"
#include "train/score_pass.h"
#include "train/stages.h"
#include "train/views.h"

enum { ITERATIONS = 120, WIDTH = 96, HEIGHT = 64, MOST_PARTS = 8, SAMPLES = 16 };

typedef struct run {
  pags_train_options options;
  pags_trainer trainer;
  pags_frame *frame; /* of the oracle */
} run;

static pags_train_config paper(void) {
  pags_train_config config = pags_train_config_default();
  config.schedule.preset = PAGS_PRESET_PAPER;
  config.schedule.iterations = ITERATIONS;
  config.schedule.resolution_floor = 24;
  return config;
}

/* Sets up a run before its first step. */
static void begin(run *r, const pags_train_config *asked) {
  const pags_train_config config = pags_config_resolve(asked, true);
  pags_trainer *const t = &r->trainer;
  r->options = pags_train_options_default();
  r->options.dataset = dataset;
  r->options.tasks = tasks;
  *t = (pags_trainer){.options = &r->options, .dataset = dataset, .tasks = tasks, .ranks = 1};
  assert_int_equal(pags_views_list(t), PAGS_OK);
  assert_int_equal(pags_photo_cache_create(dataset, tasks, r->options.image_cache, &t->cache), PAGS_OK);
  assert_int_equal(pags_trainer_start(t, &config), PAGS_OK);
  assert_int_equal(pags_share_run_begin(t), PAGS_OK);
  assert_int_equal(pags_view_render_create(t), PAGS_OK);
  assert_int_equal(pags_frame_create(tasks, &r->frame), PAGS_OK);
  assert_true(t->state.model_count > 1 && t->state.model_count <= MOST_PARTS);
}

static void end(run *r) {
  pags_trainer *const t = &r->trainer;
  pags_frame_destroy(r->frame);
  pags_photo_cache_destroy(t->cache);
  pags_view_render_destroy(t);
  pags_share_run_destroy(t);
  pags_state_destroy(&t->state);
  free(t->rest.photographs);
  free(t->rest.poses);
  free(t->views);
  free(t->order);
}

/* ---- Pictures with changed opacities ---- */

typedef struct picture {
  double sum[WIDTH * HEIGHT], alpha[WIDTH * HEIGHT]; /* of the channels; 1 - transmittance */
} picture;

/* Draws the run's current parts, with the opacity of row `row` of part `part` multiplied by `by` and that of all others
 * by `others`. */
static void draw(run *r, const pags_camera *camera, int part, int64_t row, float by, float others, picture *out) {
  const pags_view_render *const v = &r->trainer.render;
  pags_frame_options options = pags_view_render_options(&r->trainer, r->trainer.state.step);
  pags_part parts[MOST_PARTS];
  float *factors[MOST_PARTS];
  pags_picture drawn;
  for (int i = 0; i < v->part_count; i++) {
    const int64_t stride = v->parts[i].gaussians->stride;
    parts[i] = v->parts[i];
    factors[i] = malloc((size_t)stride * sizeof(float));
    assert_non_null(factors[i]);
    for (int64_t k = 0; k < stride; k++)
      factors[i][k] =
          (i == part && k == row ? by : others) * (parts[i].opacity_factor ? parts[i].opacity_factor[k] : 1);
    parts[i].opacity_factor = factors[i];
    parts[i].opacity_factor_most = 2;
  }
  assert_int_equal(pags_frame_render(r->frame, parts, v->part_count, camera, &options, NULL, NULL, &drawn), PAGS_OK);
  assert_true(drawn.width == WIDTH && drawn.height == HEIGHT);
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    const int at = i / WIDTH * drawn.stride + i % WIDTH;
    out->sum[i] = (double)drawn.rgb[0][at] + (double)drawn.rgb[1][at] + (double)drawn.rgb[2][at];
    out->alpha[i] = 1.0 - (double)drawn.transmittance[at];
  }
  for (int i = 0; i < v->part_count; i++)
    free(factors[i]);
}

/* ---- S_sem ---- */

/* The mean, over the training views that show it, of the share of a Gaussian's alpha on critical pixels; below 0: no
 * view shows it. */
static double overlap_of(run *r, int64_t model, int64_t row) {
  static picture alone;
  pags_trainer *const t = &r->trainer;
  double sum = 0;
  int64_t views = 0;
  for (int64_t i = 0; i < t->view_count; i++) {
    pags_photo photo;
    const pags_camera camera = pags_view_render_camera(t, t->views[i], 1);
    assert_int_equal(pags_photo_cache_get(t->cache, t->views[i], 1, &photo), PAGS_OK);
    pags_view_render_compose(t, t->views[i]);
    int part = 0;
    while (part < t->render.part_count && t->render.drawn[part].model != model)
      part++;
    if (part == t->render.part_count)
      continue;
    draw(r, &camera, part, row, 1, 0, &alone);
    double all = 0, critical = 0;
    for (int k = 0; k < WIDTH * HEIGHT; k++) {
      const int at = k / WIDTH * photo.stride + k % WIDTH;
      const double alpha = !photo.mask || photo.mask[at] ? alone.alpha[k] : 0;
      all += alpha;
      critical += photo.labels[at] & PAGS_LABEL_CRITICAL ? alpha : 0;
    }
    sum += all > 1e-6 ? critical / all : 0;
    views += all > 1e-6;
  }
  return views > 0 ? sum / (double)views : -1;
}

static void s_sem_is_the_mean_overlap_with_the_masks(void **unused) {
  (void)unused;
  run r;
  const pags_train_config config = paper();
  int shown = 0, partial = 0, hidden = 0;
  begin(&r, &config);
  pags_train_state *const s = &r.trainer.state;
  float *before[MOST_PARTS];
  for (int64_t m = 0; m < s->model_count; m++) {
    before[m] = malloc((size_t)s->models[m].gaussians.count * sizeof(float));
    assert_non_null(before[m]);
    memcpy(before[m], s->models[m].gaussians.s_sem, (size_t)s->models[m].gaussians.count * sizeof(float));
  }
  assert_int_equal(pags_score_pass_set_s_sem(&r.trainer), PAGS_OK);
  for (int64_t m = 0; m < s->model_count; m++) {
    const pags_gaussians *const g = &s->models[m].gaussians;
    for (int64_t row = 0; row < g->count; row += g->count / 12 + 1) {
      const double want = overlap_of(&r, m, row), got = (double)g->s_sem[row];
      if (want < 0) {
        assert_true(g->s_sem[row] == before[m][row]);
        hidden++;
        continue;
      }
      assert_true(fabs(got - want) < 1e-3);
      shown++;
      partial += want > 0.02 && want < 0.98;
    }
    free(before[m]);
  }
  print_message("%d Gaussians shown, %d of them partly critical, %d never shown\n", shown, partial, hidden);
  assert_true(shown > 20 && partial > 5);
  end(&r);
}

/* A finished scene has no value of S_sem that wasn't measured at the start: nothing measures it again, and children
 * have their parents'. */
static void s_sem_is_measured_once_and_inherited(void **unused) {
  (void)unused;
  run r;
  pags_train_config config = paper();
  pags_train_options options = pags_train_options_default();
  pags_train_result result;
  pags_scene scene;
  int64_t copies = 0;
  config.priority.prune_early = config.priority.prune_late = 0.05;
  options.dataset = dataset;
  options.tasks = tasks;
  options.output = scratch("once");
  options.preview_every = 0;
  assert_int_equal(pags_train(&config, &options, &result), PAGS_OK);
  assert_int_equal(pags_scene_load(scratch("once"), &scene), PAGS_OK);
  begin(&r, &config);
  assert_int_equal(pags_score_pass_set_s_sem(&r.trainer), PAGS_OK);
  for (int64_t m = 0; m < scene.model_count; m++) {
    pags_gaussians *const g = &scene.models[m].gaussians, *const start = &r.trainer.state.models[m].gaussians;
    pags_sort_floats(start->s_sem, start->count);
    copies += g->count - start->count;
    for (int64_t i = 0; i < g->count; i++)
      assert_non_null(
          bsearch(&g->s_sem[i], start->s_sem, (size_t)start->count, sizeof *start->s_sem, pags_compare_floats));
  }
  assert_true(copies > 0);
  pags_scene_destroy(&scene);
  end(&r);
}

/* ---- S_grad ---- */

/* The sum over pixels of the squared derivative of the pixel's colour by the value of the projected Gaussian, alpha =
 * opacity * value. A pixel's colour is linear in each alpha, so that the difference of two pictures, the second with
 * half of this Gaussian's opacity, has no error but rounding. */
static double squared_derivative(run *r, const pags_camera *camera, int part, int64_t row) {
  static picture whole, half, alone, alone_half;
  const pags_part *const p = r->trainer.render.parts + part;
  const double opacity = (double)(p->opacity_factor ? p->opacity_factor[row] : 1) /
                         (1 + exp(-(double)pags_plane(p->gaussians, PAGS_OPACITY)[row]));
  double sum = 0;
  draw(r, camera, part, row, 1, 1, &whole);
  draw(r, camera, part, row, 0.5f, 1, &half);
  draw(r, camera, part, row, 1, 0, &alone);
  draw(r, camera, part, row, 0.5f, 0, &alone_half);
  for (int i = 0; i < WIDTH * HEIGHT; i++) {
    const double less = alone.alpha[i] - alone_half.alpha[i];
    const double slope = less > 1e-6 ? opacity * (whole.sum[i] - half.sum[i]) / less : 0;
    sum += slope * slope;
  }
  return sum;
}

/* Two steps of training, with learning rates of 0 so that the oracle can draw the same pictures afterwards. Dropout
 * leaves out a fifth of the Gaussians; these get nothing. */
static void s_grad_sums_squared_derivatives_of_the_colour(void **unused) {
  (void)unused;
  run r;
  pags_train_config c = paper();
  c.optimiser.position_rate_begin = c.optimiser.position_rate_end = c.optimiser.scale_rate = 0;
  c.optimiser.rotation_rate = c.optimiser.opacity_rate = c.optimiser.sh_dc_rate = c.optimiser.sh_rest_rate = 0;
  c.sky.sky = c.exposure.exposure = 0;
  c.picture.background[0] = 0.6;
  begin(&r, &c);
  pags_trainer *const t = &r.trainer;
  double want[MOST_PARTS][SAMPLES] = {{0}};
  bool shown[MOST_PARTS] = {false};
  int left_out = 0, checked = 0;
  for (int64_t step = 98; step < 100; step++) {
    pags_state_set_step(&t->state, step - 1);
    pags_step_view v = {.number = step, .view = t->views[step % t->view_count], .level = 1};
    assert_int_equal(pags_train_round(t, step, &v, 1), PAGS_OK);
    t->rest.count = t->rest.pose_count = 0; /* the end of the step, which would update poses, is left out */
    for (int p = 0; p < t->render.part_count; p++) {
      const int64_t m = t->render.drawn[p].model, count = t->state.models[m].gaussians.count;
      shown[m] = true;
      for (int k = 0; k < SAMPLES; k++) {
        want[m][k] += squared_derivative(&r, &v.camera, p, k * (count / SAMPLES));
        left_out += t->render.parts[p].opacity_factor[k * (count / SAMPLES)] == 0;
      }
    }
  }
  for (int64_t m = 0; m < t->state.model_count; m++)
    for (int k = 0; k < SAMPLES && shown[m]; k++) {
      const double got = (double)t->state.models[m].density.squared[k * (t->state.models[m].gaussians.count / SAMPLES)];
      assert_true(fabs(got - want[m][k]) <= 0.01 * want[m][k] + 1e-5);
      checked += want[m][k] > 1e-3;
    }
  print_message("%d scores checked; %d times a Gaussian was left out\n", checked, left_out);
  assert_true(checked > 8 && left_out > 2);
  end(&r);
}

/* ---- S_hybrid ---- */

typedef struct scored {
  double score;
  int kept;
} scored;

static int by_score(const void *a, const void *b) {
  const double x = ((const scored *)a)->score, y = ((const scored *)b)->score;
  return (x > y) - (x < y);
}

/* The first prune of the paper removes the 60 % with the lowest alpha S_sem + (1 - alpha) S_grad, wherever they are,
 * and looks at no photograph. Every fifth Gaussian has had no gradient, and some of these are critical enough to
 * stay. */
static void prunes_remove_the_lowest_sums(void **unused) {
  (void)unused;
  run r;
  const pags_train_config config = paper();
  begin(&r, &config);
  pags_train_state *const s = &r.trainer.state;
  const int64_t all = pags_state_gaussian_count(s);
  scored *const rows = calloc((size_t)all, sizeof *rows);
  double *const raw = malloc((size_t)all * sizeof *raw);
  uint64_t used, peak, decoded, later;
  int64_t at = 0;
  assert_true(rows && raw && all < 1 << 24);
  for (int64_t m = 0; m < s->model_count; m++)
    for (int64_t i = 0; i < s->models[m].gaussians.count; i++, at++) {
      uint32_t bits[4];
      pags_rng_u32x4(7, 0, (uint64_t)at, bits);
      pags_plane(&s->models[m].gaussians, PAGS_SH)[i] = (float)at; /* recognises the row afterwards */
      s->models[m].gaussians.s_sem[i] = (at % 5 ? 0 : 0.9f) + (float)(bits[0] >> 8) * 0.1f * 0x1p-24f;
      s->models[m].density.squared[i] = at % 5 ? expf(20 * (float)(bits[1] >> 8) * 0x1p-24f) : 0;
      raw[at] = (double)s->models[m].density.squared[i];
      rows[at].score = 0.4 * (double)s->models[m].gaussians.s_sem[i];
    }
  double *const sorted = malloc((size_t)all * sizeof *sorted);
  assert_non_null(sorted);
  memcpy(sorted, raw, (size_t)all * sizeof *raw);
  pags_sort_doubles(sorted, all);
  for (int64_t i = 0; i < all; i++) { /* S_grad: the share of the others with less */
    int64_t lower = 0;
    for (int64_t step = (int64_t)1 << 23; step > 0; step /= 2)
      lower += lower + step <= all && sorted[lower + step - 1] < raw[i] ? step : 0;
    rows[i].score += 0.6 * (double)lower / (double)(all - 1);
  }
  pags_state_set_step(s, s->schedule.prune_step[0]);
  pags_state_settle(s, tasks);
  pags_photo_cache_figures(r.trainer.cache, &used, &peak, &decoded);
  assert_int_equal(pags_prune(&r.trainer, 0), PAGS_OK);
  pags_photo_cache_figures(r.trainer.cache, &used, &peak, &later);
  assert_int_equal(later, decoded);
  const int64_t left = pags_state_gaussian_count(s);
  assert_int_equal(left, all - (int64_t)(0.6 * (double)all));
  for (int64_t m = 0; m < s->model_count; m++)
    for (int64_t i = 0; i < s->models[m].gaussians.count; i++)
      rows[(int64_t)pags_plane(&s->models[m].gaussians, PAGS_SH)[i]].kept++;
  qsort(rows, (size_t)all, sizeof *rows, by_score);
  const double threshold = rows[all - left].score;
  for (int64_t i = 0; i < all; i++)
    assert_true(fabs(rows[i].score - threshold) < 1e-6 || rows[i].kept == (rows[i].score > threshold));
  free(rows);
  free(raw);
  free(sorted);
  end(&r);
}

/* Data sets without labels: S_sem is 0 for all, and the pass before the first step is left out. */
static void without_labels_the_gradient_decides(void **unused) {
  (void)unused;
  const pags_train_config config = paper(), c = pags_config_resolve(&config, false);
  assert_int_equal(c.priority.score, PAGS_SCORE_PAPER);
  assert_true(fabs(pags_prune_hybrid(&c, 0, 0.5) - 0.3) < 1e-15);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(s_sem_is_the_mean_overlap_with_the_masks),
      cmocka_unit_test(s_sem_is_measured_once_and_inherited),
      cmocka_unit_test(s_grad_sums_squared_derivatives_of_the_colour),
      cmocka_unit_test(prunes_remove_the_lowest_sums),
      cmocka_unit_test(without_labels_the_gradient_decides),
  };
  return cmocka_run_group_tests(tests, make_street, remove_street);
}
