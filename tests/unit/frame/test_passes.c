/* SPDX-License-Identifier: Apache-2.0 */
/* Compares Cryptomattes, expected normals, motion vectors and counts of pairs with sums over the contributions of
 * the double-precision oracle. */
#include <pags/passes.h>

#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

enum { WIDTH = 101, HEIGHT = 67, PIXELS = WIDTH * HEIGHT, STRIDE = 112, ROWS = 80 };
enum { SCENES = 3, PARTS = SCENES * FRAME_SCENE_PARTS, EACH = 60, COUNT = PARTS * EACH, NAMES = 9 };
enum { PLANES = 2 * PAGS_MATTE_PLANES + 3 + 4 + 2, PAIRS = PLANES - 2 };

typedef struct fixture {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part parts[PARTS];
  double before[PARTS][12], after[PARTS][12]; /* world_from_model at the other times */
  pags_camera cameras[2];
  int32_t names[2][PARTS];
  float values[NAMES];
} fixture;

/* Moves a pose a little: up to 2 degrees and 20 cm. */
static void nudge(reference_random *random, const double pose[12], double out[12]) {
  double turn[3], place[3], motion[12];
  for (int k = 0; k < 3; k++) {
    turn[k] = reference_uniform(random, -0.035, 0.035);
    place[k] = reference_uniform(random, -0.2, 0.2);
  }
  pags_rigid_from_angles(turn, place, motion);
  pags_rigid_multiply(pose, motion, out);
}

static void begin(fixture *f) {
  *f = (fixture){.random = {11}, .options = reference_options()};
  f->options.keep_for_passes = 1;
  f->options.count_pairs = 1;
  f->options.origin[0] = 4.5;
  f->camera = reference_random_camera(&f->random, WIDTH, HEIGHT);
  reference_recipe recipe = reference_recipe_default();
  for (int p = 0; p < PARTS; p++) {
    f->parts[p] = reference_part_create(EACH, 1);
    f->parts[p].first_id = p * EACH;
    reference_random_pose(&f->random, 2, f->parts[p].world_from_model);
    for (int64_t i = 0; i < EACH; i++)
      reference_random_gaussian(&f->random, &recipe, &f->camera, &f->options, &f->parts[p], i);
    frame_scene_round(&f->parts[p]);
    memcpy(f->before[p], f->parts[p].world_from_model, sizeof f->before[p]);
    memcpy(f->after[p], f->parts[p].world_from_model, sizeof f->after[p]);
    if (p % 3) {
      nudge(&f->random, f->parts[p].world_from_model, f->before[p]);
      nudge(&f->random, f->parts[p].world_from_model, f->after[p]);
    }
    f->names[0][p] = p % NAMES;
    f->names[1][p] = p % 4 - 1;
  }
  for (int side = 0; side < 2; side++) {
    f->cameras[side] = f->camera;
    nudge(&f->random, f->camera.world_from_camera, f->cameras[side].world_from_camera);
    f->cameras[side].fx *= side ? 1.02 : 1;
  }
  for (int k = 0; k < NAMES; k++)
    f->values[k] = (float)(NAMES - k) + 0.5f;
}

static void end(fixture *f) {
  for (int p = 0; p < PARTS; p++)
    reference_part_destroy(&f->parts[p]);
}

/* ---- The engine ---- */

typedef struct result {
  float planes[PLANES][PIXELS], rgb[3][PIXELS], transmittance[PIXELS];
  int64_t pairs[2]; /* blended and computed pairs of the whole picture, from the frame's statistics */
} result;

static void copy(const float *plane, float *out) {
  for (int y = 0; y < HEIGHT; y++)
    memcpy(out + (size_t)y * WIDTH, plane + (size_t)y * STRIDE, WIDTH * sizeof *out);
}

typedef struct asked {
  int threads, cluster_size;
  int moved; /* moments before and after: 0: the frame's time for both; 1: those of the fixture; 2: no moment before */
} asked;

static void run(const fixture *f, asked how, result *out) {
  frame_scene scenes[SCENES];
  pags_part parts[3][PARTS];
  pags_tasks *const tasks = pags_tasks_create(how.threads);
  pags_frame *frame;
  pags_picture picture;
  pags_passes passes;
  for (int s = 0; s < SCENES; s++) {
    scenes[s] = frame_scene_create(f->parts + s * FRAME_SCENE_PARTS, FRAME_SCENE_PARTS, how.cluster_size, 0);
    for (int p = 0; p < FRAME_SCENE_PARTS; p++) { /* a scene is returned by value: its pointers are set again */
      scenes[s].parts[p].gaussians = &scenes[s].gaussians[p];
      scenes[s].parts[p].clusters = &scenes[s].clusters[p];
      for (int k = 0; k < 3; k++)
        parts[k][s * FRAME_SCENE_PARTS + p] = scenes[s].parts[p];
    }
  }
  for (int p = 0; p < PARTS && how.moved; p++) {
    memcpy(parts[1][p].world_from_model, f->before[p], sizeof f->before[p]);
    memcpy(parts[2][p].world_from_model, f->after[p], sizeof f->after[p]);
  }
  /* Parts are found by the ids of their Gaussians, in any order of parts. */
  const pags_part first = parts[1][0];
  parts[1][0] = parts[1][5];
  parts[1][5] = first;
  const pags_moment moments[2] = {
      {.camera = how.moved ? f->cameras[0] : f->camera, .parts = parts[1], .part_count = PARTS},
      {.camera = how.moved ? f->cameras[1] : f->camera, .parts = parts[2], .part_count = PARTS}};
  const pags_matte mattes[2] = {{NAMES, f->values, f->names[0]}, {NAMES, f->values, f->names[1]}};
  const pags_pass_request request = {.matte = {&mattes[0], &mattes[1]},
                                     .normal = 1,
                                     .motion = 1,
                                     .pairs = 1,
                                     .before = how.moved == 2 ? NULL : &moments[0],
                                     .after = &moments[1]};
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  for (int round = 0; round < 2; round++) { /* twice: the first frame leaves nothing behind */
    assert_int_equal(pags_frame_render(frame, parts[0], PARTS, &f->camera, &f->options, NULL, NULL, &picture), PAGS_OK);
    assert_int_equal(picture.stride, STRIDE);
    if (f->options.keep_for_passes)
      assert_int_equal(pags_frame_passes(frame, &request, &passes), PAGS_OK);
  }
  for (int c = 0; c < 3; c++)
    copy(picture.rgb[c], out->rgb[c]);
  copy(picture.transmittance, out->transmittance);
  for (int k = 0; k < PLANES && f->options.keep_for_passes; k++)
    copy(k < 2 * PAGS_MATTE_PLANES       ? passes.matte[k / PAGS_MATTE_PLANES][k % PAGS_MATTE_PLANES]
         : k < 2 * PAGS_MATTE_PLANES + 3 ? passes.normal[k - 2 * PAGS_MATTE_PLANES]
         : k < PAIRS                     ? passes.motion[k - 2 * PAGS_MATTE_PLANES - 3]
                                         : passes.pairs[k - PAIRS],
         out->planes[k]);
  const pags_frame_stats *const stats = pags_frame_stats_get(frame);
  out->pairs[0] = stats->pairs_blended;
  out->pairs[1] = stats->pairs_evaluated;
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  for (int s = 0; s < SCENES; s++)
    frame_scene_destroy(&scenes[s]);
}

/* ---- The oracle: sums over the contributions, in double ---- */

typedef struct sums {
  double names[2][NAMES], normal[3], weight, motion[4], motion_size[4]; /* size: sum of w |m| */
} sums;

static void oracle_normal(const fixture *f, const reference_part *part, int64_t i, double out[3]) {
  const reference_view view = reference_view_of(part, &f->camera, &f->options);
  double q[4], r[9], n[3], to_eye = 0;
  int shortest = 0;
  for (int k = 1; k < 3; k++)
    if (reference_value(part, PAGS_SCALE + k, i) < reference_value(part, PAGS_SCALE + shortest, i))
      shortest = k;
  for (int k = 0; k < 4; k++)
    q[k] = reference_value(part, PAGS_ROTATION + k, i);
  pags_rotation_from_quaternion(q, r);
  for (int k = 0; k < 3; k++) {
    n[k] = r[3 * k + shortest];
    to_eye += n[k] * (view.position[k] - reference_value(part, PAGS_MEAN + k, i));
  }
  for (int k = 0; k < 3; k++) {
    out[k] = 0;
    for (int j = 0; j < 3; j++)
      out[k] += (to_eye < 0 ? -1 : 1) * part->world_from_model[4 * k + j] * n[j];
  }
}

/* Projects a point of the world into a picture; returns false for points behind the camera. */
static bool project(const pags_camera *camera, const double origin[3], const double point[3], double xy[2]) {
  double pose[12], inverse[12], p[3];
  memcpy(pose, camera->world_from_camera, sizeof pose);
  for (int k = 0; k < 3; k++)
    pose[4 * k + 3] -= origin[k];
  pags_rigid_inverse(pose, inverse);
  pags_rigid_point(inverse, point, p);
  xy[0] = camera->fx * p[0] / p[2] + camera->cx;
  xy[1] = camera->fy * p[1] / p[2] + camera->cy;
  return p[2] > 0;
}

/* The motion of the point at depth z on a pixel's ray; part NULL: of a point at infinity. */
static void oracle_motion(const fixture *f, int part, double z, int pixel, double out[4]) {
  const double x = pixel % WIDTH + 0.5, y = pixel / WIDTH + 0.5;
  const double far = part < 0 ? 1e9 : z;
  const double ray[3] = {(x - f->camera.cx) / f->camera.fx * far, (y - f->camera.cy) / f->camera.fy * far, far};
  double world[3], model[3], pose[12], inverse[12], xy[2];
  pags_rigid_point(f->camera.world_from_camera, ray, world);
  for (int k = 0; k < 3; k++)
    world[k] -= f->options.origin[k];
  for (int side = 0; side < 2; side++) {
    double then[3] = {world[0], world[1], world[2]};
    if (part >= 0) {
      memcpy(pose, f->parts[part].world_from_model, sizeof pose);
      pags_rigid_inverse(pose, inverse);
      pags_rigid_point(inverse, world, model);
      pags_rigid_point(side ? f->after[part] : f->before[part], model, then);
    }
    const double sign = side ? -1 : 1;
    const bool ahead = project(&f->cameras[side], f->options.origin, then, xy);
    out[2 * side] = ahead ? sign * (xy[0] - x) : 0;
    out[2 * side + 1] = ahead ? -sign * (xy[1] - y) : 0;
  }
}

static sums *oracle(const fixture *f, const reference_picture *picture) {
  sums *const all = reference_alloc(PIXELS, sizeof *all);
  for (int64_t k = 0; k < picture->contribution_count; k++) {
    const reference_contribution *const c = &picture->contributions[k];
    const int part = (int)(c->gaussian / EACH);
    const double w = fmin(REFERENCE_ALPHA_CAP, c->alpha_raw) * c->transmittance;
    double normal[3], motion[4];
    sums *const s = &all[c->pixel];
    oracle_normal(f, &f->parts[part], c->gaussian % EACH, normal);
    oracle_motion(f, part, picture->splats[c->gaussian].camera[2], c->pixel, motion);
    for (int m = 0; m < 2; m++)
      if (f->names[m][part] >= 0)
        s->names[m][f->names[m][part]] += w;
    for (int j = 0; j < 3; j++)
      s->normal[j] += w * normal[j];
    for (int j = 0; j < 4; j++) {
      s->motion[j] += w * motion[j];
      s->motion_size[j] += w * fabs(motion[j]);
    }
    s->weight += w;
  }
  for (int pixel = 0; pixel < PIXELS; pixel++) {
    double motion[4];
    oracle_motion(f, -1, 0, pixel, motion);
    for (int j = 0; j < 4; j++) {
      all[pixel].motion[j] += picture->transmittance[pixel] * motion[j];
      all[pixel].motion_size[j] += picture->transmittance[pixel] * fabs(motion[j]);
    }
    for (int j = 0; j < 3 && all[pixel].weight > 0; j++)
      all[pixel].normal[j] /= all[pixel].weight;
  }
  return all;
}

/* Compares a pixel's ranks: each sum equals the oracle's of the same name, and no name left out has a larger sum. A
 * weight is a product of tens of float factors: 2e-5 is a hundred times their rounding. */
static int compare_matte(const fixture *f, const result *got, const sums *want, int m, int pixel) {
  double left[NAMES], least = INFINITY;
  int ranks = 0;
  memcpy(left, want->names[m], sizeof left);
  for (int k = 0; k < PAGS_MATTE_RANKS; k++) {
    const double value = (double)got->planes[m * PAGS_MATTE_PLANES + 2 * k][pixel];
    const double sum = (double)got->planes[m * PAGS_MATTE_PLANES + 2 * k + 1][pixel];
    assert_true(sum <= least);
    if (value == 0) {
      assert_true(sum == 0);
      least = 0;
      continue;
    }
    const int name = (int)(NAMES + 0.5 - value);
    assert_true(name >= 0 && name < NAMES && (double)f->values[name] == value);
    assert_true(fabs(sum - want->names[m][name]) < 2e-5);
    left[name] = 0;
    least = sum;
    ranks++;
  }
  for (int name = 0; name < NAMES; name++)
    assert_true(left[name] <= (ranks == PAGS_MATTE_RANKS ? least : 0) + 2e-5);
  return ranks;
}

static void passes_match_the_oracle(void **unused) {
  (void)unused;
  fixture f;
  result *const got = reference_alloc(1, sizeof *got);
  begin(&f);
  run(&f, (asked){.threads = 2, .cluster_size = 32, .moved = 1}, got);
  reference_picture picture = reference_render(f.parts, PARTS, &f.camera, &f.options);
  sums *const want = oracle(&f, &picture);
  int compared = 0, full = 0, none = 0;
  double moved = 0;
  for (int pixel = 0; pixel < PIXELS; pixel++) {
    /* Float rounding may decide otherwise here. */
    if (picture.margin[pixel] < 1e-4 || picture.depth_margin[pixel] < 1e-6)
      continue;
    compared++;
    full += compare_matte(&f, got, &want[pixel], 0, pixel) == PAGS_MATTE_RANKS;
    none += compare_matte(&f, got, &want[pixel], 1, pixel) < 3;
    for (int k = 0; k < 3; k++) /* a quotient whose divisor, the sum of weights, may be small */
      assert_true(fabs((double)got->planes[2 * PAGS_MATTE_PLANES + k][pixel] - want[pixel].normal[k]) <
                  2e-5 + 2e-6 / fmax(want[pixel].weight, 1e-3));
    for (int k = 0; k < 4;
         k++) { /* tolerance in px: differences of coordinates of about 100 px in float, and the weights' 2e-5 */
      const double error = fabs((double)got->planes[2 * PAGS_MATTE_PLANES + 3 + k][pixel] - want[pixel].motion[k]);
      assert_true(error < 2e-4 + 4e-5 * want[pixel].motion_size[k]);
      moved = fmax(moved, fabs(want[pixel].motion[k]));
    }
  }
  assert_true(compared > PIXELS / 2 && full > 100 && none > 100 && moved > 5);
  free(want);
  free(got);
  reference_picture_destroy(&picture);
  end(&f);
}

/* ---- Counts of pairs ---- */

/* The least d' conic d from the splat's middle to a point of the rectangle of a block's pixel centres: 0 inside, else
 * on one of the four sides, where the quadratic along the side has its least value at its vertex or an end. */
static double least_quadratic(const reference_splat *s, double x0, double y0) {
  const double side = 3, a = s->conic[0], b = s->conic[1], c = s->conic[2];
  const double x = x0 - s->mean2d[0], y = y0 - s->mean2d[1];
  if (x <= 0 && x + side >= 0 && y <= 0 && y + side >= 0)
    return 0;
  double least = INFINITY;
  for (int k = 0; k < 2; k++) {
    const double fixed_x = x + side * k, fixed_y = y + side * k;
    const double v = fmin(fmax(-b * fixed_x / c, y), y + side), u = fmin(fmax(-b * fixed_y / a, x), x + side);
    least = fmin(least, a * fixed_x * fixed_x + 2 * b * fixed_x * v + c * v * v);
    least = fmin(least, a * u * u + 2 * b * u * fixed_y + c * fixed_y * fixed_y);
  }
  return least;
}

/* Returns the number of splats that reach into the block whose first pixel is (x, y); slack: tolerance of alpha as a
 * share. */
static int reaching(const reference_picture *picture, int x, int y, double slack) {
  int count = 0;
  for (int64_t i = 0; i < picture->splat_count; i++) {
    const reference_splat *const s = &picture->splats[i];
    count += s->drawn && s->opacity * exp(-least_quadratic(s, x + 0.5, y + 0.5) / 2) >= s->least * (1 + slack);
  }
  return count;
}

static void pairs_match_the_oracle(void **unused) {
  (void)unused;
  fixture f;
  result *const got = reference_alloc(1, sizeof *got);
  int *const blended = reference_alloc(PIXELS, sizeof *blended);
  begin(&f);
  run(&f, (asked){.threads = 2, .cluster_size = 32}, got);
  reference_picture picture = reference_render(f.parts, PARTS, &f.camera, &f.options);
  for (int64_t k = 0; k < picture.contribution_count; k++)
    blended[picture.contributions[k].pixel]++;

  /* Blended pairs are compared up to the last Gaussian at which float rounding can't change a decision. */
  int compared = 0, most = 0;
  double totals[2] = {0, 0};
  for (int pixel = 0; pixel < PIXELS; pixel++) {
    totals[0] += (double)got->planes[PAIRS][pixel];
    assert_true(got->planes[PAIRS][pixel] <= got->planes[PAIRS + 1][pixel]);
    if (picture.margin[pixel] < 1e-4 || picture.depth_margin[pixel] < 1e-6)
      continue;
    assert_true(got->planes[PAIRS][pixel] == (float)blended[pixel]);
    compared++;
    most = blended[pixel] > most ? blended[pixel] : most;
  }
  assert_true(compared > PIXELS / 2 && most > 20);

  /* Computed pairs: the Gaussians that reach into the block, all of them if no pixel of it stops. Excluded Gaussians
   * fall short of the cut by at least 0.02 powers of two (PAGS_CUT_SLACK). With 0.01 for rounding, computed Gaussians
   * may fall short by 2.1 % of alpha. */
  int open = 0, stopped = 0;
  for (int y = 0; y < HEIGHT; y += 4)
    for (int x = 0; x < WIDTH; x += 4) {
      const double computed = (double)got->planes[PAIRS + 1][y * WIDTH + x];
      bool stops = false;
      totals[1] += 16 * computed;
      for (int v = y; v < y + 4 && v < HEIGHT; v++)
        for (int u = x; u < x + 4 && u < WIDTH; u++) {
          assert_true((double)got->planes[PAIRS + 1][v * WIDTH + u] == computed);
          stops |= picture.transmittance[v * WIDTH + u] < 0.02; /* an alpha of 0.99 may stop it */
        }
      assert_true(computed <= reaching(&picture, x, y, -0.021));
      assert_true(stops || computed >= reaching(&picture, x, y, 1e-3));
      open += !stops && computed > 0;
      stopped += stops;
    }
  assert_true(open > 20 && stopped > 20);
  assert_true(totals[0] == (double)got->pairs[0] && totals[1] == (double)got->pairs[1]);
  free(blended);
  free(got);
  reference_picture_destroy(&picture);
  end(&f);
}

static void threads_and_clusters_change_no_bit(void **unused) {
  (void)unused;
  fixture f;
  result *const first = reference_alloc(1, sizeof *first), *const other = reference_alloc(1, sizeof *other);
  begin(&f);
  run(&f, (asked){.threads = 1, .cluster_size = 64, .moved = 1}, first);
  for (int threads = 2; threads <= 7; threads++) {
    run(&f, (asked){.threads = threads, .cluster_size = threads % 2 ? 16 : 64, .moved = 1}, other);
    assert_memory_equal(first, other, sizeof *first);
  }
  free(first);
  free(other);
  end(&f);
}

static void passes_do_not_change_the_picture(void **unused) {
  (void)unused;
  fixture f;
  result *const with = reference_alloc(1, sizeof *with), *const without = reference_alloc(1, sizeof *without);
  begin(&f);
  for (int degree = 3; degree <= 5; degree += 2) {
    f.options.exp_degree = degree;
    f.options.keep_for_passes = 1;
    run(&f, (asked){.threads = 2, .cluster_size = 64}, with);
    f.options.keep_for_passes = 0;
    run(&f, (asked){.threads = 2, .cluster_size = 64}, without);
    assert_memory_equal(with->rgb, without->rgb, sizeof with->rgb);
    assert_memory_equal(with->transmittance, without->transmittance, sizeof with->transmittance);
    /* Weights and transmittance add up to 1. With two hundred terms the error is about their number times 2^-24. */
    for (int pixel = 0; pixel < PIXELS; pixel++) {
      float sum = with->transmittance[pixel];
      for (int k = 0; k < PAGS_MATTE_RANKS; k++)
        sum += with->planes[2 * k + 1][pixel];
      assert_true(sum < 1.00002f);
      if (with->planes[PAGS_MATTE_PLANES - 1][pixel] == 0.0f)
        assert_true(sum > 0.99998f);
    }
  }
  free(with);
  free(without);
  end(&f);
}

static void resting_objects_have_no_motion(void **unused) {
  (void)unused;
  fixture f;
  result *const still = reference_alloc(1, sizeof *still), *const half = reference_alloc(1, sizeof *half),
                *const both = reference_alloc(1, sizeof *both);
  begin(&f);
  run(&f, (asked){.threads = 2, .cluster_size = 64, .moved = 0}, still);
  run(&f, (asked){.threads = 2, .cluster_size = 64, .moved = 2}, half);
  run(&f, (asked){.threads = 2, .cluster_size = 64, .moved = 1}, both);
  const int motion = 2 * PAGS_MATTE_PLANES + 3;
  for (int pixel = 0; pixel < PIXELS; pixel++) {
    for (int k = 0; k < 4; k++)
      assert_true(still->planes[motion + k][pixel] == 0.0f);
    assert_true(half->planes[motion][pixel] == 0.0f && half->planes[motion + 1][pixel] == 0.0f);
  }
  assert_memory_equal(half->planes[motion + 2], both->planes[motion + 2], 2 * sizeof both->planes[motion]);
  free(still);
  free(half);
  free(both);
  end(&f);
}

/* Checks signs with known values: a wall of one Gaussian that fills the picture moves 1 px to the right and 2 px
 * down each frame. */
static void motion_has_blender_s_signs(void **unused) {
  (void)unused;
  fixture f = {.options = reference_options()};
  pags_gaussians g;
  pags_clusters clusters;
  pags_frame *frame;
  pags_picture picture;
  pags_passes passes;
  f.options.keep_for_passes = 1;
  f.camera = (pags_camera){.width = 32, .height = 32, .fx = 20, .fy = 20, .cx = 16, .cy = 16};
  const double wall[14] = {0, 0, 2, 3, 3, -3, 1, 0, 0, 0, 8, 0, 0, 0};
  const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  memcpy(f.camera.world_from_camera, identity, sizeof identity);
  assert_int_equal(pags_gaussians_create(&g, 1, 0), PAGS_OK);
  for (int plane = 0; plane < 14; plane++)
    pags_plane(&g, plane)[0] = (float)wall[plane];
  assert_int_equal(pags_clusters_create(&clusters, 1, 64), PAGS_OK);
  pags_clusters_update(&clusters, &g, 0, 1);
  pags_part parts[3];
  for (int k = 0; k < 3; k++) {
    parts[k] = (pags_part){.gaussians = &g, .clusters = &clusters};
    memcpy(parts[k].world_from_model, identity, sizeof identity);
  }
  parts[1].world_from_model[3] = -0.1, parts[1].world_from_model[7] = -0.2; /* one frame earlier; 0.1 is 1 px */
  parts[2].world_from_model[3] = 0.1, parts[2].world_from_model[7] = 0.2;
  const pags_moment before = {f.camera, &parts[1], 1}, after = {f.camera, &parts[2], 1};
  const pags_pass_request request = {.normal = 1, .motion = 1, .before = &before, .after = &after};
  pags_tasks *const tasks = pags_tasks_create(1);
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, parts, 1, &f.camera, &f.options, NULL, NULL, &picture), PAGS_OK);
  assert_int_equal(pags_frame_passes(frame, &request, &passes), PAGS_OK);
  const int64_t middle = 16 * picture.stride + 16;
  const double shown = 1 - (double)picture.transmittance[middle]; /* 0.99; points at infinity don't move */
  const double want[4] = {-1, 2, -1, 2}, normal[3] = {0, 0, -1};
  for (int k = 0; k < 4; k++)
    assert_float_equal(passes.motion[k][middle], (float)(shown * want[k]), 1e-4);
  for (int k = 0; k < 3; k++)
    assert_float_equal(passes.normal[k][middle], normal[k], 1e-6);
  assert_null(passes.matte[0][0]);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  pags_clusters_destroy(&clusters);
  pags_gaussians_destroy(&g);
}

/* The hashes of "bunny" and "default" are those of the Cryptomatte specification's example. */
static void names_are_hashed_as_specified(void **unused) {
  (void)unused;
  assert_int_equal(pags_cryptomatte_hash("", 0), 0);
  assert_int_equal(pags_cryptomatte_hash("bunny", 5), 0x13851a76);
  assert_int_equal(pags_cryptomatte_hash("default", 7), 0x42c9679f);
  assert_int_equal(pags_cryptomatte_hash("hello", 5), 0x248bfa47);
  const uint32_t hashes[][2] = {{0x13851a76, 0x13851a76}, {0x007fffff, 0x00ffffff}, {0x80000001, 0x80800001},
                                {0x7f812345, 0x7f012345}, {0xffffffff, 0xff7fffff}, {0, 0x00800000}};
  for (size_t i = 0; i < sizeof hashes / sizeof *hashes; i++) {
    const float value = pags_cryptomatte_value(hashes[i][0]);
    uint32_t bits;
    memcpy(&bits, &value, sizeof bits);
    assert_int_equal(bits, hashes[i][1]);
    assert_true(isnormal(value));
  }
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(passes_match_the_oracle),
      cmocka_unit_test(pairs_match_the_oracle),
      cmocka_unit_test(threads_and_clusters_change_no_bit),
      cmocka_unit_test(passes_do_not_change_the_picture),
      cmocka_unit_test(resting_objects_have_no_motion),
      cmocka_unit_test(motion_has_blender_s_signs),
      cmocka_unit_test(names_are_hashed_as_specified),
  };
  return cmocka_run_group_tests_name("passes", tests, NULL, NULL);
}
