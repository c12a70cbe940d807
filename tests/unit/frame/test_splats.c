/* SPDX-License-Identifier: Apache-2.0 */
/* Tests frames drawn from the splats of several owners (engine/frame/splats.c): picture, gradients, scores and the
 * sky's gradient have the bits of one frame that draws all Gaussians. */
#include "unit/random_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

#include "frame/shared_splats.h"

enum { SIZE = 16, MOST_PIECES = 5, STRIDE = (WIDTH + 15) / 16 * 16, ROWS = (HEIGHT + 15) / 16 * 16, SCORES = 3 };
enum { FIRST = 900, SECOND = 333, ALL = FIRST + SECOND, SKY = 30 };

/* The results of a frame's backward pass by id, and the picture. */
typedef struct outcome {
  int64_t count;
  float *gradient, *statistics; /* [count][PAGS_MAX_PLANES]; [count][2]: mean2d, radius */
  uint8_t *drawn, *bad;
  double *scores; /* [count][SCORES] */
  float planes[5][STRIDE * HEIGHT];
  float *sky;
  int64_t bad_rows;
} outcome;

/* The Gaussians [begin, end) of each part, as one owner holds them. */
typedef struct piece {
  pags_part parts[2];
  pags_gaussians gaussians[2];
  pags_clusters clusters[2];
  float *factors[2];
  pags_frame *frame;
  outcome *out;
} piece;

static void check(pags_result result) {
  assert_int_equal(result, PAGS_OK);
}

static void *zeros(int64_t count, size_t size) {
  void *const block = calloc((size_t)count + 1, size);
  assert_non_null(block);
  return block;
}

static outcome *outcome_create(int64_t count) {
  outcome *const o = zeros(1, sizeof *o);
  o->count = count;
  o->gradient = zeros(count * PAGS_MAX_PLANES, sizeof(float));
  o->statistics = zeros(count * 2, sizeof(float));
  o->drawn = zeros(count, 1);
  o->bad = zeros(count, 1);
  o->scores = zeros(count * SCORES, sizeof(double));
  o->sky = zeros(18 * SKY * SKY + 3 * PAGS_SKY_BLOCK, sizeof(float));
  return o;
}

static void outcome_destroy(outcome *o) {
  free(o->gradient);
  free(o->statistics);
  free(o->drawn);
  free(o->bad);
  free(o->scores);
  free(o->sky);
  free(o);
}

static void receive(void *user, const pags_cluster_gradient *g, int worker) {
  const piece *const p = user;
  (void)worker;
  for (int i = 0; i < g->count; i++) {
    const int64_t id = p->parts[g->part].first_id + g->first + i;
    for (int k = 0; k < g->planes; k++)
      p->out->gradient[id * PAGS_MAX_PLANES + k] = g->data[k * g->stride + i];
    p->out->statistics[2 * id] = g->mean2d[i];
    p->out->statistics[2 * id + 1] = g->radius[i];
    p->out->drawn[id] = g->drawn[i];
    p->out->bad[id] = g->bad[i];
  }
}

static void receive_scores(void *user, const pags_cluster_score *s, int worker) {
  const piece *const p = user;
  (void)worker;
  for (int i = 0; i < s->count; i++) {
    double *const to = p->out->scores + SCORES * (p->parts[s->part].first_id + s->first + i);
    to[0] = s->seen[i], to[1] = s->critical[i], to[2] = s->squared[i];
  }
}

static void receive_sky(void *user, const pags_sky_gradient *g, int worker) {
  outcome *const o = user;
  (void)worker;
  const int64_t floats = 3 * PAGS_SKY_BLOCK;
  for (int64_t b = 0; b < g->blocks; b++)
    if (g->seen[b])
      memcpy(o->sky + 3 * g->first + floats * b, g->data + floats * b, (size_t)floats * sizeof(float));
}

static void copy_picture(const pags_picture *picture, outcome *o) {
  const float *const planes[5] = {picture->rgb[0], picture->rgb[1], picture->rgb[2], picture->transmittance,
                                  picture->depth_sum};
  assert_int_equal(picture->stride, STRIDE);
  for (int k = 0; k < 5; k++)
    for (int y = 0; y < HEIGHT; y++)
      memcpy(o->planes[k] + STRIDE * y, planes[k] + STRIDE * y, WIDTH * sizeof(float));
}

/* Loss and weights that differ from pixel to pixel. */
static float gradients[5][STRIDE * ROWS], counted[2][STRIDE * ROWS];
static void fill_planes(fixture *f) {
  for (int i = 0; i < STRIDE * ROWS; i++) {
    for (int k = 0; k < 5; k++)
      gradients[k][i] = (float)reference_uniform(&f->random, -1, 1);
    counted[0][i] = (float)reference_uniform(&f->random, 0, 1);
    counted[1][i] = (float)reference_uniform(&f->random, 0, 1);
  }
}

static pags_picture_gradient loss(outcome *o) {
  return (pags_picture_gradient){.rgb = {gradients[0], gradients[1], gradients[2]},
                                 .transmittance = gradients[3],
                                 .depth_sum = gradients[4],
                                 .sky = receive_sky,
                                 .sky_user = o};
}

static const pags_score_planes score_planes = {.counted = counted[0], .critical = counted[1]};

/* Rows [begin, end) of the scene's parts. Empty parts have no clusters. */
static void piece_create(piece *p, const frame_scene *scene, const int64_t begin[2], const int64_t end[2],
                         pags_tasks *tasks, outcome *o) {
  *p = (piece){.out = o};
  check(pags_frame_create(tasks, &p->frame));
  for (int k = 0; k < 2; k++) {
    const pags_gaussians *const from = &scene->gaussians[k];
    check(pags_gaussians_create(&p->gaussians[k], end[k] - begin[k], from->sh_degree));
    p->gaussians[k].alpha_min = from->alpha_min;
    for (int plane = 0; plane < pags_plane_count(from->sh_degree); plane++)
      for (int64_t i = begin[k]; i < end[k]; i++)
        pags_plane(&p->gaussians[k], plane)[i - begin[k]] = pags_plane(from, plane)[i];
    check(pags_clusters_create(&p->clusters[k], end[k] - begin[k], SIZE));
    pags_clusters_update(&p->clusters[k], &p->gaussians[k], 0, p->clusters[k].count);
    p->parts[k] = scene->parts[k];
    p->parts[k].gaussians = &p->gaussians[k];
    p->parts[k].clusters = &p->clusters[k];
    p->parts[k].first_id = scene->parts[k].first_id + (int32_t)begin[k];
    if (scene->parts[k].opacity_factor) { /* a copy of the factors for each owner */
      p->parts[k].opacity_factor = p->factors[k] = zeros(p->gaussians[k].stride, sizeof(float));
      for (int64_t i = begin[k]; i < end[k]; i++)
        p->factors[k][i - begin[k]] = scene->parts[k].opacity_factor[i];
    }
  }
}

static void piece_destroy(piece *p) {
  pags_frame_destroy(p->frame);
  for (int k = 0; k < 2; k++) {
    pags_clusters_destroy(&p->clusters[k]);
    pags_gaussians_destroy(&p->gaussians[k]);
    free(p->factors[k]);
  }
}

static outcome *draw_whole(const fixture *f, const frame_scene *scene, pags_tasks *tasks) {
  outcome *const o = outcome_create(ALL);
  piece all;
  pags_picture picture;
  const int64_t none[2] = {0, 0}, ends[2] = {scene->gaussians[0].count, scene->gaussians[1].count};
  piece_create(&all, scene, none, ends, tasks, o);
  check(pags_frame_render(all.frame, all.parts, 2, &f->camera, &f->options, NULL, NULL, &picture));
  copy_picture(&picture, o);
  const pags_picture_gradient gradient = loss(o);
  check(pags_frame_backward(all.frame, &gradient, receive, &all, &o->bad_rows));
  check(pags_frame_scores(all.frame, &score_planes, receive_scores, &all));
  piece_destroy(&all);
  return o;
}

/* Draws the scene by `count` owners, whose parts are cut at random multiples of SIZE rows. first_part 1: only splats
 * of the second part are drawn and have gradients. */
static outcome *draw_pieces(fixture *f, const frame_scene *scene, int count, int first_part, pags_tasks *tasks) {
  outcome *const o = outcome_create(ALL);
  piece pieces[MOST_PIECES];
  int64_t taken[MOST_PIECES], before[MOST_PIECES], all = 0, begin[2] = {0, 0};
  pags_sent_splat *splats = zeros(o->count, sizeof *splats);
  pags_frame *frame;
  check(pags_frame_create(tasks, &frame));
  for (int k = 0; k < count; k++) {
    int64_t end[2];
    for (int p = 0; p < 2; p++) {
      const int64_t rows = scene->gaussians[p].count, left = (rows - begin[p]) / SIZE;
      end[p] = k == count - 1 ? rows : begin[p] + SIZE * (int64_t)reference_uniform(&f->random, 0, (double)left);
    }
    piece_create(&pieces[k], scene, begin, end, tasks, o);
    memcpy(begin, end, sizeof begin);
    check(
        pags_frame_project(pieces[k].frame, frame, pieces[k].parts, 2, &f->camera, &f->options, NULL, NULL, &taken[k]));
    pags_sent_splat *own = zeros(taken[k], sizeof *own);
    check(pags_frame_take_splats(pieces[k].frame, own));
    before[k] = pags_frame_splats_before(pieces[k].frame, first_part);
    memcpy(splats + all, own + before[k], (size_t)(taken[k] - before[k]) * sizeof *own);
    all += taken[k] - before[k];
    free(own);
    for (int p = 0; p < 2 && pieces[k].factors[p]; p++) /* training draws the dropout factors of the next view here */
      memset(pieces[k].factors[p], 0, (size_t)pieces[k].gaussians[p].stride * sizeof(float));
  }
  pags_picture picture;
  check(pags_frame_draw_splats(frame, splats, all, scene->gaussians[0].alpha_min, &f->camera, &f->options, &picture));
  copy_picture(&picture, o);
  free(splats); /* the frame has copied them */
  pags_splat_sums *const sums = zeros(all, sizeof *sums);
  pags_splat_scores *const scores = zeros(all, sizeof *scores);
  const pags_picture_gradient gradient = loss(o);
  check(pags_frame_splat_sums(frame, &gradient, sums));
  check(pags_frame_splat_scores(frame, &score_planes, scores));
  int64_t at = 0;
  for (int k = 0; k < count; k++) {
    int64_t bad = 0;
    pags_splat_sums *const own = zeros(taken[k], sizeof *own);
    memcpy(own + before[k], sums + at, (size_t)(taken[k] - before[k]) * sizeof *own);
    check(pags_frame_return_sums(pieces[k].frame, first_part, own, receive, &pieces[k], &bad));
    if (first_part == 0)
      check(pags_frame_return_scores(pieces[k].frame, scores + at, receive_scores, &pieces[k]));
    o->bad_rows += bad;
    at += taken[k] - before[k];
    free(own);
    piece_destroy(&pieces[k]);
  }
  free(sums);
  free(scores);
  pags_frame_destroy(frame);
  return o;
}

/* Rows from `first` on are compared; the rest of `got` must be untouched. */
static void assert_same(const outcome *expected, const outcome *got, int64_t first) {
  assert_memory_equal(expected->planes, got->planes, sizeof expected->planes);
  assert_memory_equal(expected->sky, got->sky, (size_t)(18 * SKY * SKY) * sizeof(float));
  assert_int_equal(expected->bad_rows, got->bad_rows);
  const size_t rows = (size_t)(expected->count - first);
  assert_memory_equal(expected->gradient + first * PAGS_MAX_PLANES, got->gradient + first * PAGS_MAX_PLANES,
                      rows * PAGS_MAX_PLANES * sizeof(float));
  assert_memory_equal(expected->statistics + 2 * first, got->statistics + 2 * first, 2 * rows * sizeof(float));
  assert_memory_equal(expected->drawn + first, got->drawn + first, rows);
  assert_memory_equal(expected->bad + first, got->bad + first, rows);
  for (int64_t i = 0; i < first; i++)
    assert_false(got->drawn[i]);
  if (first == 0)
    assert_memory_equal(expected->scores, got->scores, (size_t)expected->count * SCORES * sizeof(double));
}

typedef struct scene_of_two {
  fixture first, second;
  frame_scene scene;
  pags_sky sky;
} scene_of_two;

/* Two parts; many pairs of Gaussians have the same depth, so that their ids decide. */
static void scene_create(scene_of_two *s, uint64_t seed) {
  s->first = fixture_create(seed, FIRST);
  s->second = fixture_create(seed, SECOND);
  for (int64_t i = 0; i + 1 < FIRST; i += 3)
    for (int k = 0; k < 3; k++)
      *fixture_at(&s->first, PAGS_MEAN + k, i + 1) = *fixture_at(&s->first, PAGS_MEAN + k, i);
  for (int64_t i = 0; i < 100; i++)
    for (int k = 0; k < 3; k++)
      *fixture_at(&s->second, PAGS_MEAN + k, i) = *fixture_at(&s->first, PAGS_MEAN + k, 7 * i);
  s->second.part.first_id = FIRST;
  for (int64_t i = 400; i < 440; i++) /* rows behind the camera */
    for (int k = 0; k < 3; k++)
      *fixture_at(&s->first, PAGS_MEAN + k, i) =
          2 * s->first.camera.world_from_camera[4 * k + 3] - *fixture_at(&s->first, PAGS_MEAN + k, i);
  *fixture_at(&s->first, PAGS_ROTATION, 5) = 1e30; /* a row whose gradient isn't finite */
  const reference_part parts[2] = {s->first.part, s->second.part};
  s->scene = frame_scene_create(parts, 2, SIZE, 0);
  s->sky = reference_random_sky(&s->first.random, SKY);
  pags_frame_options *const o = &s->first.options;
  *o = pags_frame_options_default();
  memcpy(o->origin, s->second.options.origin, sizeof o->origin);
  o->early_z = PAGS_EARLY_Z_OFF; /* as in training */
  o->keep_for_backward = 1;
  o->depth_sum = 1;
  o->sky = &s->sky;
  fill_planes(&s->first);
}

static void scene_destroy(scene_of_two *s) {
  frame_scene_destroy(&s->scene);
  free(s->sky.texels);
  fixture_destroy(&s->first);
  fixture_destroy(&s->second);
}

static void test_pieces_are_one_frame(void **state) {
  (void)state;
  scene_of_two s;
  scene_create(&s, 21);
  pags_tasks *const tasks = pags_tasks_create(2);
  outcome *const whole = draw_whole(&s.first, &s.scene, tasks);
  int64_t drawn = 0, second = 0;
  for (int64_t i = 0; i < whole->count; i++) {
    drawn += whole->drawn[i];
    second += i >= FIRST && whole->drawn[i];
  }
  assert_in_range(drawn, 500, whole->count - 1);
  assert_in_range(second, 100, SECOND);
  for (int round = 0; round < 3; round++)
    for (int count = 1; count <= MOST_PIECES; count++) {
      outcome *const got = draw_pieces(&s.first, &s.scene, count, 0, tasks);
      assert_same(whole, got, 0);
      outcome_destroy(got);
    }
  outcome_destroy(whole);
  pags_tasks_destroy(tasks);
  scene_destroy(&s);
}

/* ---- State of splats that owners keep ---- */

typedef struct view_kind {
  const char *name;
  pags_lens_model lens;
  int antialiased, rolls, factors;
} view_kind;

/* Makes colours so dark that none, one or several channels are clamped. */
static void darken(scene_of_two *s, float *factors[2]) {
  for (int p = 0; p < 2; p++) {
    fixture *const f = p ? &s->second : &s->first;
    const int64_t count = p ? SECOND : FIRST;
    factors[p] = zeros(count + 64, sizeof(float));
    for (int64_t i = 0; i < count; i++) {
      factors[p][i] = i % 5 == 0 ? 0.0f : (float)reference_uniform(&f->random, 0.5, 3);
      for (int c = 0; c < 3; c++)
        if (i >> c & 1)
          *fixture_at(f, PAGS_SH + c, i) = -4;
    }
  }
}

/* Draws a scene by one frame and by owners, and compares them. Counts the colour channels of drawn Gaussians without
 * a gradient. */
static void check_kind(const view_kind *kind, uint64_t seed) {
  scene_of_two s;
  float *factors[2];
  scene_create(&s, seed);
  darken(&s, factors);
  const reference_part parts[2] = {s.first.part, s.second.part};
  frame_scene_destroy(&s.scene);
  s.scene = frame_scene_create(parts, 2, SIZE, 0);
  for (int p = 0; p < 2 && kind->factors; p++) {
    s.scene.parts[p].opacity_factor = factors[p];
    s.scene.parts[p].opacity_factor_most = 3;
  }
  s.first.options.antialiased = kind->antialiased;
  s.first.camera.lens = kind->lens;
  if (kind->rolls) {
    assert_true(pags_shutter_set(&s.first.camera.shutter, "top_to_bottom", 0.03));
    for (int k = 0; k < 6; k++)
      s.first.camera.shutter.velocity[k] = k < 3 ? 0.3 : 4;
    s.scene.parts[1].velocity[0] = 5;
  }
  assert_int_equal(pags_camera_check(&s.first.camera, kind->name), PAGS_OK);
  pags_tasks *const tasks = pags_tasks_create(2);
  outcome *const whole = draw_whole(&s.first, &s.scene, tasks);
  int64_t drawn = 0, held[3] = {0, 0, 0};
  for (int64_t i = 0; i < whole->count; i++) {
    drawn += whole->drawn[i];
    for (int c = 0; c < 3; c++)
      held[c] += whole->drawn[i] && whole->gradient[i * PAGS_MAX_PLANES + PAGS_SH + c] == 0.0f &&
                 whole->gradient[i * PAGS_MAX_PLANES + PAGS_OPACITY] != 0.0f;
  }
  assert_in_range(drawn, 300, whole->count - 1);
  for (int c = 0; c < 3; c++) /* about half of each channel is clamped */
    assert_in_range(held[c], drawn / 5, drawn * 4 / 5);
  for (int count = 1; count <= MOST_PIECES; count += 2) {
    outcome *const got = draw_pieces(&s.first, &s.scene, count, 0, tasks);
    assert_same(whole, got, 0);
    outcome_destroy(got);
  }
  outcome_destroy(whole);
  pags_tasks_destroy(tasks);
  free(factors[0]);
  free(factors[1]);
  scene_destroy(&s);
}

/* Draws each kind of view for which owners keep one byte a Gaussian for the backward pass. */
static void test_kept_of_each_camera(void **state) {
  static const view_kind kinds[] = {
      {"pinhole", {0}, 0, 0, 0},
      {"antialiased", {0}, 1, 0, 0},
      {"antialiased, dropout", {0}, 1, 0, 1},
      {"lens", {.kind = PAGS_LENS_FISHEYE, .k = {-0.06, 0.012, -0.0006}, .field = 200}, 0, 0, 0},
      {"antialiased lens", {.kind = PAGS_LENS_PERSPECTIVE, .k = {-0.15, 0.03}, .p = {0.002, -0.003}}, 1, 0, 1},
      {"rolling shutter", {0}, 0, 1, 0},
      {"antialiased rolling shutter, dropout", {0}, 1, 1, 1}};
  (void)state;
  for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
    check_kind(kinds + k, 23 + k);
}

/* Draws a second picture of only the second part, from splats that were projected once, as training's loss term of
 * moving objects does. */
static void test_pieces_of_one_part(void **state) {
  (void)state;
  scene_of_two s;
  scene_create(&s, 22);
  pags_tasks *const tasks = pags_tasks_create(2);
  frame_scene only = s.scene;
  only.gaussians[0].count = 0;
  outcome *const whole = draw_whole(&s.first, &only, tasks);
  for (int count = 1; count <= MOST_PIECES; count++) {
    outcome *const got = draw_pieces(&s.first, &s.scene, count, 1, tasks);
    assert_memory_equal(whole->planes, got->planes, sizeof whole->planes);
    assert_memory_equal(whole->gradient + FIRST * PAGS_MAX_PLANES, got->gradient + FIRST * PAGS_MAX_PLANES,
                        SECOND * PAGS_MAX_PLANES * sizeof(float));
    for (int64_t i = 0; i < FIRST; i++)
      assert_false(got->drawn[i]);
    outcome_destroy(got);
  }
  outcome_destroy(whole);
  pags_tasks_destroy(tasks);
  scene_destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_pieces_are_one_frame),
                                     cmocka_unit_test(test_kept_of_each_camera),
                                     cmocka_unit_test(test_pieces_of_one_part)};
  return cmocka_run_group_tests(tests, NULL, NULL);
}
