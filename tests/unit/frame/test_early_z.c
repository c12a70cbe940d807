/* SPDX-License-Identifier: Apache-2.0 */
/* Early-Z: the mode LOSSLESS gives the bits of OFF, and BOUNDED keeps its error bound. This holds on random and
 * adversarial scenes for any division into depth slabs, number of threads and cluster size.
 *
 * PAGS_EARLY_Z_SCENES=N runs N random scenes in place of 200. */
#include <setjmp.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>
#include <pags/frame.h>

enum { MOST_PARTS = 3, MOST_GAUSSIANS = 3000, SIDE = 112 };

/* Random numbers: splitmix64. */
static uint64_t state;
static uint64_t next_u64(void) {
  uint64_t z = (state += 0x9E3779B97F4A7C15u);
  z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
  z = (z ^ z >> 27) * 0x94D049BB133111EBu;
  return z ^ z >> 31;
}
static int below(int n) {
  return (int)(next_u64() % (uint64_t)n);
}
static float uniform(float lo, float hi) {
  return lo + (hi - lo) * (float)(next_u64() >> 40) * 0x1p-24f;
}
static float log_uniform(float lo, float hi) {
  return expf(uniform(logf(lo), logf(hi)));
}

/* ---- Scenes, all in front of a camera at the origin that looks along z ---- */

typedef enum recipe {
  OPAQUE_WALLS,
  TRANSLUCENT_WALLS,
  NEEDLES,
  GIANTS,
  DUST,
  INSIDE,
  SAME_DEPTH,
  BEHIND,
  NOTHING,
  ONE,
  MIXTURE,
  RECIPES
} recipe;

typedef struct scene {
  int part_count;
  pags_part parts[MOST_PARTS];
  pags_gaussians gaussians[MOST_PARTS];
  pags_clusters clusters[MOST_PARTS];
  int32_t *ids[MOST_PARTS];
  pags_camera camera;
  pags_frame_options options;
  float sky_texels[6 * 2 * 2 * 3];
  pags_sky sky;
} scene;

static void put(pags_gaussians *g, int64_t i, int plane, float value) {
  pags_plane(g, plane)[i] = value;
}

static void put_shape(pags_gaussians *g, int64_t i, const float mean[3], const float sigma[3], float opacity) {
  for (int k = 0; k < 3; k++) {
    put(g, i, PAGS_MEAN + k, mean[k]);
    put(g, i, PAGS_SCALE + k, logf(sigma[k]));
  }
  for (int k = 0; k < 4; k++)
    put(g, i, PAGS_ROTATION + k, uniform(-1, 1));
  put(g, i, PAGS_OPACITY, logf(opacity / (1 - opacity)));
  for (int plane = PAGS_SH; plane < pags_plane_count(g->sh_degree); plane++)
    put(g, i, plane, uniform(-1, 1));
}

static void put_random(pags_gaussians *g, int64_t i, recipe r) {
  const float layer = (float)below(6), z = 2 + 1.5f * layer + uniform(0, 0.1f);
  float mean[3] = {uniform(-0.7f, 0.7f) * z, uniform(-0.7f, 0.7f) * z, z};
  float size = log_uniform(0.05f, 0.6f), opacity = uniform(0.9f, 0.9999f);
  float sigma[3] = {size, size * uniform(0.3f, 1), size * uniform(0.05f, 1)};
  if (r == MIXTURE)
    r = (recipe)below(SAME_DEPTH);
  if (r == TRANSLUCENT_WALLS)
    opacity = uniform(0.02f, 0.5f);
  if (r == NEEDLES)
    sigma[0] = log_uniform(0.5f, 50), sigma[1] = sigma[2] = log_uniform(1e-4f, 0.02f);
  if (r == GIANTS)
    sigma[0] = log_uniform(1, 1000), sigma[1] = log_uniform(1, 1000), opacity = uniform(0.01f, 0.999f);
  if (r == DUST)
    sigma[0] = sigma[1] = sigma[2] = log_uniform(1e-4f, 0.01f), opacity = uniform(0.005f, 0.9f);
  if (r == INSIDE)
    for (int k = 0; k < 3; k++)
      mean[k] = uniform(-0.3f, 0.3f), sigma[k] = log_uniform(0.1f, 5);
  if (r == SAME_DEPTH)
    mean[2] = (float)(2 + below(4));
  if (r == BEHIND)
    mean[2] = -mean[2];
  put_shape(g, i, mean, sigma, opacity);
}

static void rotate_part(pags_part *part) {
  const double yaw = (double)uniform(-0.3f, 0.3f), c = cos(yaw), s = sin(yaw);
  const double pose[12] = {c,  0, s, (double)uniform(-1, 1), 0, 1, 0, (double)uniform(-1, 1),
                           -s, 0, c, (double)uniform(0, 2)};
  memcpy(part->world_from_model, pose, sizeof pose);
}

static void add_part(scene *s, recipe r, int64_t count, int32_t *first_id) {
  static const int sizes[] = {16, 48, 64, 256};
  const int p = s->part_count++;
  assert_int_equal(pags_gaussians_create(&s->gaussians[p], count, below(4)), PAGS_OK);
  for (int64_t i = 0; i < count; i++)
    put_random(&s->gaussians[p], i, r);
  assert_int_equal(pags_clusters_create(&s->clusters[p], count, sizes[below(4)]), PAGS_OK);
  pags_clusters_update(&s->clusters[p], &s->gaussians[p], 0, s->clusters[p].count);
  s->ids[p] = below(2) ? malloc((size_t)(count + 1) * sizeof(int32_t)) : NULL;
  for (int64_t i = 0; s->ids[p] && i < count; i++)
    s->ids[p][i] = *first_id + (int32_t)(count - 1 - i);
  s->parts[p] = (pags_part){.gaussians = &s->gaussians[p],
                            .clusters = &s->clusters[p],
                            .id = s->ids[p],
                            .first_id = *first_id,
                            .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  if (p > 0)
    rotate_part(&s->parts[p]);
  *first_id += (int32_t)count;
}

/* Sorts the rows in Morton order, as in real scenes, where neighbouring rows lie close together. */
static void sort_near_together(pags_gaussians *g) {
  int64_t *const index = malloc((size_t)(g->count + 1) * sizeof *index);
  pags_gaussians sorted;
  assert_int_equal(pags_gaussians_morton_order(g, index), PAGS_OK);
  assert_int_equal(pags_gaussians_create_like(&sorted, g->count, g), PAGS_OK);
  pags_gaussians_gather(g, index, g->count, &sorted);
  free(index);
  pags_gaussians_destroy(g);
  *g = sorted;
}

static void scene_create(scene *s, recipe r, int64_t count) {
  int32_t first_id = 0;
  memset(s, 0, sizeof *s);
  const int parts = r == NOTHING || r == ONE ? 1 : 1 + below(MOST_PARTS);
  for (int p = 0; p < parts; p++)
    add_part(s, r, r == NOTHING ? 0 : r == ONE ? 1 : count / parts + below(30), &first_id);
  for (int p = 0; p < parts && below(4); p++) {
    sort_near_together(&s->gaussians[p]);
    pags_clusters_update(&s->clusters[p], &s->gaussians[p], 0, s->clusters[p].count);
  }
  const int width = 1 + below(SIDE), height = 1 + below(SIDE);
  s->camera = (pags_camera){.width = width,
                            .height = height,
                            .fx = width * (double)uniform(0.5f, 1.5f),
                            .fy = height * (double)uniform(0.5f, 1.5f),
                            .cx = width * 0.5,
                            .cy = height * 0.5,
                            .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  s->options = pags_frame_options_default();
  s->options.early_z = PAGS_EARLY_Z_OFF;
  for (int c = 0; c < 3; c++)
    s->options.background[c] = uniform(0, 1);
  for (size_t i = 0; i < sizeof s->sky_texels / sizeof *s->sky_texels; i++)
    s->sky_texels[i] = uniform(0, 1);
  s->sky = (pags_sky){.size = 2, .texels = s->sky_texels};
  s->options.sky = below(2) ? &s->sky : NULL;
  s->options.extra_channels = below(4) > 0;
  s->options.exp_degree = below(2) ? 5 : 3;
  s->options.antialiased = below(2);
  for (int p = 0; p < parts; p++)
    s->gaussians[p].alpha_min = below(2) ? uniform(0.005f, 0.03f) : 0.0f;
}

static void scene_destroy(scene *s) {
  for (int p = 0; p < s->part_count; p++) {
    pags_gaussians_destroy(&s->gaussians[p]);
    pags_clusters_destroy(&s->clusters[p]);
    free(s->ids[p]);
  }
}

/* The planes of a rendered picture, copied without row padding. */
typedef struct shot {
  float *planes; /* red, green, blue, transmittance, depth, depth sum */
  int32_t *id;
  int64_t pixels;
  pags_frame_stats stats;
} shot;

enum { PLANES = 6 };

static shot shoot_parts(pags_tasks *tasks, const scene *s, const pags_frame_options *options) {
  pags_frame *frame;
  pags_picture picture;
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, s->parts, s->part_count, &s->camera, options, NULL, NULL, &picture),
                   PAGS_OK);
  const int64_t width = picture.width, pixels = width * picture.height;
  shot out = {calloc((size_t)pixels * PLANES, sizeof(float)), calloc((size_t)pixels, sizeof(int32_t)), pixels,
              *pags_frame_stats_get(frame)};
  const float *const planes[PLANES] = {picture.rgb[0],        picture.rgb[1], picture.rgb[2],
                                       picture.transmittance, picture.depth,  picture.depth_sum};
  for (int y = 0; y < picture.height; y++) {
    for (int p = 0; p < PLANES; p++)
      if (planes[p])
        memcpy(out.planes + p * pixels + y * width, planes[p] + (int64_t)y * picture.stride,
               (size_t)width * sizeof(float));
    if (picture.id)
      memcpy(out.id + y * width, picture.id + (int64_t)y * picture.stride, (size_t)width * sizeof(int32_t));
  }
  pags_frame_destroy(frame);
  return out;
}

static shot shoot(int threads, const scene *s, pags_early_z mode, float eps, int64_t slab) {
  pags_tasks *const tasks = pags_tasks_create(threads);
  pags_frame_options options = s->options;
  options.early_z = mode;
  options.early_z_eps = eps;
  options.slab_size = slab;
  const shot out = shoot_parts(tasks, s, &options);
  pags_tasks_destroy(tasks);
  return out;
}

static void shot_destroy(shot *s) {
  free(s->planes);
  free(s->id);
}

static int same_bits(const shot *a, const shot *b) {
  return memcmp(a->planes, b->planes, (size_t)a->pixels * PLANES * sizeof(float)) == 0 &&
         memcmp(a->id, b->id, (size_t)a->pixels * sizeof(int32_t)) == 0;
}

/* An upper bound on every colour that the picture can show: of any Gaussian, of the sky and of the background. The SH
 * coefficients lie in [-1, 1], so that a colour is at most 0.5 plus the largest sum of |Y_k| up to the Gaussian's
 * degree. */
static float largest_colour(const scene *s) {
  float largest = 1; /* background and sky texels are <= 1 */
  static const float bound[4] = {0.2821f, 0.2821f + 0.8463f, 0.2821f + 0.8463f + 2.4f, 0.2821f + 0.8463f + 2.4f + 4.6f};
  for (int p = 0; p < s->part_count; p++)
    if (s->gaussians[p].count)
      largest = fmaxf(largest, 0.5f + bound[s->gaussians[p].sh_degree]);
  return largest;
}

static void check_bound(const shot *off, const shot *bounded, float eps, float largest, uint64_t seed) {
  const float rounding = 1e-4f * largest; /* float rounding: 2^-24 per blended Gaussian, 1700 of them */
  for (int64_t i = 0; i < off->pixels; i++) {
    const float t = fabsf(off->planes[3 * off->pixels + i] - bounded->planes[3 * off->pixels + i]);
    if (t > eps)
      fail_msg("seed %llu: pixel %lld: transmittance off by %g, bound %g", (unsigned long long)seed, (long long)i,
               (double)t, (double)eps);
    for (int c = 0; c < 3; c++) {
      const float d = fabsf(off->planes[c * off->pixels + i] - bounded->planes[c * off->pixels + i]);
      if (!(d <= eps * largest + rounding))
        fail_msg("seed %llu: pixel %lld: colour off by %g, bound %g", (unsigned long long)seed, (long long)i, (double)d,
                 (double)(eps * largest));
    }
  }
}

typedef struct totals {
  int64_t pixels, hidden, clusters_hidden, pairs_hidden, tiles_full, slabs;
} totals;

static void check_scene(uint64_t seed, recipe r, int64_t count, totals *sum) {
  scene s;
  state = seed;
  scene_create(&s, r, count);
  const int64_t slab = 1 + below(400);
  const float eps = below(2) ? 1.0f / 255.0f : log_uniform(1e-5f, 0.5f);
  shot off = shoot(1, &s, PAGS_EARLY_Z_OFF, 0.5f, 0);
  shot lossless = shoot(1 + below(2), &s, PAGS_EARLY_Z_LOSSLESS, 0.5f, slab);
  shot bounded = shoot(1, &s, PAGS_EARLY_Z_BOUNDED, eps, slab);
  shot again = shoot(2, &s, PAGS_EARLY_Z_BOUNDED, eps, 1 + below(4000));
  if (!same_bits(&off, &lossless))
    fail_msg("seed %llu, recipe %d: lossless differs from off", (unsigned long long)seed, (int)r);
  if (!same_bits(&bounded, &again))
    fail_msg("seed %llu, recipe %d: bounded depends on the slabs", (unsigned long long)seed, (int)r);
  check_bound(&off, &bounded, eps, largest_colour(&s), seed);
  sum->pixels += off.pixels;
  sum->hidden += lossless.stats.hidden;
  sum->clusters_hidden += lossless.stats.clusters_hidden;
  sum->pairs_hidden += lossless.stats.pairs_hidden;
  sum->tiles_full += lossless.stats.tiles_full;
  sum->slabs += lossless.stats.slabs;
  shot_destroy(&off), shot_destroy(&lossless), shot_destroy(&bounded), shot_destroy(&again);
  scene_destroy(&s);
}

static void print_totals(const char *what, int64_t scenes, const totals *t) {
  print_message(
      "%s: %lld scenes, %lld pixels, %lld slabs, %lld tiles full, hidden: %lld Gaussians, %lld clusters, %lld pairs\n",
      what, (long long)scenes, (long long)t->pixels, (long long)t->slabs, (long long)t->tiles_full,
      (long long)t->hidden, (long long)t->clusters_hidden, (long long)t->pairs_hidden);
}

static void test_random_scenes(void **unused) {
  (void)unused;
  const char *const wanted = getenv("PAGS_EARLY_Z_SCENES");
  const int64_t scenes = wanted ? strtoll(wanted, NULL, 10) : 200;
  totals sum = {0};
  for (int64_t i = 0; i < scenes; i++) {
    state = (uint64_t)i * 77777 + 5;
    check_scene((uint64_t)i + 1, (recipe)below(RECIPES), below(MOST_GAUSSIANS), &sum);
  }
  print_totals("random", scenes, &sum);
  assert_true(scenes < 200 ||
              (sum.hidden > 0 && sum.clusters_hidden > 0 && sum.pairs_hidden > 0 && sum.tiles_full > 0));
}

static void test_every_recipe(void **unused) {
  (void)unused;
  totals sum = {0};
  for (int r = 0; r < RECIPES; r++)
    check_scene(1000 + (uint64_t)r, (recipe)r, MOST_GAUSSIANS, &sum);
  print_totals("recipes", RECIPES, &sum);
}

/* The bound holds for the final picture: after photometric calibration and exposure, also with a partly negative
 * background or sky. Colours, of degree 0, are at most 0.79. */
static void test_bound_is_of_the_picture(void **unused) {
  (void)unused;
  const float eps = 1.0f / 255.0f;
  for (int k = 0; k < 12; k++) {
    scene s;
    state = 4242 + (uint64_t)k;
    scene_create(&s, k % 2 ? INSIDE : MIXTURE, MOST_GAUSSIANS);
    s.options.sh_degree = 0;
    if (k % 3 == 0)
      s.options.photometric =
          (pags_photometric){.vignette = {0.0, 0.4, 0.9, 1.5}, .response = {0.1, 0.3, 0.25, 0.2, 0.1}};
    assert_true(pags_photometric_is_valid(&s.options.photometric));
    if (k % 3 < 2)
      pags_frame_options_expose(&s.options, (double[3]){1, 4, -2.5}, (double[3]){0, -0.5, 0.1});
    s.sky.dip = 1.0f;
    for (int c = 0; c < 3; c++)
      s.options.background[c] = k % 4 == 1 ? -1.0f : s.options.background[c];
    for (size_t i = 0; k % 4 == 2 && i < sizeof s.sky_texels / sizeof *s.sky_texels; i++)
      s.sky_texels[i] = -1.0f;
    shot off = shoot(1, &s, PAGS_EARLY_Z_OFF, 0.5f, 0), bounded = shoot(1, &s, PAGS_EARLY_Z_BOUNDED, eps, 300);
    check_bound(&off, &bounded, eps, 1.0f, (uint64_t)k);
    shot_destroy(&off), shot_destroy(&bounded);
    scene_destroy(&s);
  }
}

/* The names of the modes are parsed. */
static void test_parse(void **unused) {
  (void)unused;
  pags_frame_options o = pags_frame_options_default();
  assert_int_equal(o.early_z, PAGS_EARLY_Z_LOSSLESS);
  assert_int_equal(pags_early_z_parse("off", &o), PAGS_OK);
  assert_int_equal(o.early_z, PAGS_EARLY_Z_OFF);
  assert_int_equal(pags_early_z_parse("bounded=0.01", &o), PAGS_OK);
  assert_int_equal(o.early_z, PAGS_EARLY_Z_BOUNDED);
  assert_float_equal(o.early_z_eps, 0.01f, 0);
  assert_int_equal(pags_early_z_parse("bounded", &o), PAGS_OK);
  assert_float_equal(o.early_z_eps, 1.0f / 255.0f, 0);
  static const char *const wrong[] = {"",          "on",          "bounded=",     "bounded=0",  "bounded=1",
                                      "bounded=x", "bounded=nan", "bounded=0.1x", "lossless=1", "lossles"};
  for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
    assert_int_equal(pags_early_z_parse(wrong[i], &o), PAGS_ERROR_ARGUMENT);
  assert_int_equal(o.early_z, PAGS_EARLY_Z_BOUNDED);
  for (int mode = 0; mode <= PAGS_EARLY_Z_PAPER; mode++) {
    assert_int_equal(pags_early_z_parse(pags_early_z_name((pags_early_z)mode), &o), PAGS_OK);
    assert_int_equal((int)o.early_z, mode);
  }
}

enum { LAYERS = 12, BEHIND_WALL = 800 };

/* A wall of opaque layers that fills a picture whose size is no multiple of a tile, and Gaussians behind it. */
static void walled(scene *s) {
  state = 9;
  scene_create(s, NOTHING, 0);
  scene_destroy(s);
  s->part_count = 1;
  s->camera.width = 37, s->camera.height = 21, s->camera.fx = s->camera.fy = 30, s->camera.cx = 18, s->camera.cy = 10;
  assert_int_equal(pags_gaussians_create(&s->gaussians[0], LAYERS + BEHIND_WALL, 0), PAGS_OK);
  for (int64_t i = 0; i < LAYERS + BEHIND_WALL; i++) {
    const float wall[3] = {0, 0, 2 + 0.01f * (float)i}, wide[3] = {40, 40, 0.001f}, small[3] = {0.3f, 0.3f, 0.3f};
    const float behind[3] = {uniform(-3, 3), uniform(-3, 3), uniform(6, 9)};
    put_shape(&s->gaussians[0], i, i < LAYERS ? wall : behind, i < LAYERS ? wide : small, 0.95f);
    put(&s->gaussians[0], i, PAGS_ROTATION, 1);
    for (int q = 1; q < 4; q++)
      put(&s->gaussians[0], i, PAGS_ROTATION + q, 0);
  }
  assert_int_equal(pags_clusters_create(&s->clusters[0], LAYERS + BEHIND_WALL, 16), PAGS_OK);
  pags_clusters_update(&s->clusters[0], &s->gaussians[0], 0, s->clusters[0].count);
  s->parts[0].id = NULL;
  s->ids[0] = NULL;
}

/* The padding pixels of border tiles count as saturated: the wall saturates every tile, and Gaussians behind it are
 * never loaded. */
static void test_padding(void **unused) {
  (void)unused;
  scene s;
  walled(&s);
  shot off = shoot(1, &s, PAGS_EARLY_Z_OFF, 0.5f, 0), lossless = shoot(2, &s, PAGS_EARLY_Z_LOSSLESS, 0.5f, 16);
  assert_true(same_bits(&off, &lossless));
  assert_int_equal(lossless.stats.tiles_full, lossless.stats.tiles);
  assert_true(lossless.stats.loaded <= 64 && lossless.stats.clusters_hidden >= 40);
  shot_destroy(&off), shot_destroy(&lossless);
  scene_destroy(&s);
}

/* In a scene of millions of Gaussians even the first frame loads only visible ones: here thousands of copies stand
 * one behind the other. */
static void test_first_of_many(void **unused) {
  (void)unused;
  enum { COPIES = 10000 };
  scene s;
  walled(&s);
  pags_part *const parts = calloc(COPIES, sizeof *parts);
  pags_tasks *const tasks = pags_tasks_create(2);
  pags_frame *frame;
  pags_picture picture;
  assert_non_null(parts);
  for (int i = 0; i < COPIES; i++) {
    parts[i] = s.parts[0];
    parts[i].first_id = i * (LAYERS + BEHIND_WALL);
    parts[i].world_from_model[11] += i;
  }
  s.options.early_z = PAGS_EARLY_Z_LOSSLESS;
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, parts, COPIES, &s.camera, &s.options, NULL, NULL, &picture), PAGS_OK);
  const pags_frame_stats *const stats = pags_frame_stats_get(frame);
  assert_true(stats->gaussians > 8000000 && stats->in_view > stats->gaussians / 2);
  assert_true(stats->loaded < stats->in_view / 8 && stats->tiles_full == stats->tiles);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  free(parts);
  scene_destroy(&s);
}

/* If the frame chooses the number of slabs, it probes the scene first and uses slabs when much is hidden; no bit
 * changes. The paper's modes draw as well and report the Gaussians left out. */
static void test_choice(void **unused) {
  (void)unused;
  scene s;
  state = 21;
  scene_create(&s, OPAQUE_WALLS, MOST_GAUSSIANS);
  pags_tasks *const tasks = pags_tasks_create(2);
  pags_frame_options options = s.options;
  for (int p = 0; p < s.part_count; p++)
    s.parts[p].s_sem = 1;
  shot off = shoot_parts(tasks, &s, &options);
  options.early_z = PAGS_EARLY_Z_LOSSLESS;
  shot lossless = shoot_parts(tasks, &s, &options);
  assert_true(same_bits(&off, &lossless));
  options.early_z = PAGS_EARLY_Z_PAPER;
  shot paper = shoot_parts(tasks, &s, &options), again;
  assert_true(paper.stats.occluders > 0 && paper.stats.hidden > 0 && paper.stats.pairs_hidden > 0);
  assert_false(same_bits(&off, &paper));
  for (int64_t i = 0; i < paper.pixels; i++) /* transmittances stay within [0, 1] */
    assert_true(paper.planes[3 * paper.pixels + i] >= 0 && paper.planes[3 * paper.pixels + i] <= 1);
  for (int p = 0; p < s.part_count; p++)
    s.parts[p].s_sem = 0;
  /* Without critical parts there are no occluders, and nothing is left out. */
  again = shoot_parts(tasks, &s, &options);
  assert_true(again.stats.occluders == 0 && same_bits(&off, &again));
  options.early_z = PAGS_EARLY_Z_OFF;
  options.order = PAGS_ORDER_PAPER; /* all parts are of one kind, so that the paper's order is the same */
  shot sorted = shoot_parts(tasks, &s, &options);
  assert_true(same_bits(&off, &sorted));
  s.parts[s.part_count - 1].s_sem = 1;
  shot split = shoot_parts(tasks, &s, &options);
  assert_true(s.part_count == 1 || !same_bits(&off, &split));
  shot_destroy(&off), shot_destroy(&lossless), shot_destroy(&paper), shot_destroy(&again), shot_destroy(&sorted),
      shot_destroy(&split);
  pags_tasks_destroy(tasks);
  scene_destroy(&s);
}

/* From the third frame on no heap call is made, however much is hidden. */
static void test_steady(void **unused) {
  (void)unused;
  scene s;
  state = 3;
  scene_create(&s, OPAQUE_WALLS, MOST_GAUSSIANS);
  pags_tasks *const tasks = pags_tasks_create(2);
  pags_frame *frame;
  pags_picture picture;
  uint64_t calls = 0;
  assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
  s.options.early_z = PAGS_EARLY_Z_LOSSLESS;
  for (int i = 0; i < 8; i++) {
    s.options.slab_size = 300;
    assert_int_equal(pags_frame_render(frame, s.parts, s.part_count, &s.camera, &s.options, NULL, NULL, &picture),
                     PAGS_OK);
    if (i == 2)
      calls = pags_frame_heap_calls(frame);
  }
  assert_int_equal(pags_frame_heap_calls(frame), calls);
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  scene_destroy(&s);
}

/* ---- Frames one after the other ---- */

enum { CAMERAS = 200, ORDERS = 4 };

static void street_camera(pags_camera *camera, int i) {
  const double yaw = 0.4 * sin(0.13 * i), c = cos(yaw), s = sin(yaw);
  const double pose[12] = {c, 0, s, 0.01 * i - 1, 0, 1, 0, 0.1 * sin(0.31 * i), -s, 0, c, 0.004 * i};
  memcpy(camera->world_from_camera, pose, sizeof pose);
}

/* Draws camera i of the street and returns a hash of the picture's bits (FNV-1a); counts frames drawn in slabs. */
static uint64_t draw_one(pags_frame *frame, scene *s, int i, pags_early_z mode, int *in_slabs) {
  pags_picture picture;
  s->options.early_z = mode;
  street_camera(&s->camera, i);
  assert_int_equal(pags_frame_render(frame, s->parts, s->part_count, &s->camera, &s->options, NULL, NULL, &picture),
                   PAGS_OK);
  *in_slabs += pags_frame_stats_get(frame)->slabs > 1;
  uint64_t hash = 0xCBF29CE484222325u;
  for (int plane = 0; plane < 4; plane++)
    for (int y = 0; y < picture.height; y++)
      for (int x = 0; x < picture.width; x++) {
        uint32_t bits;
        memcpy(&bits, (plane < 3 ? picture.rgb[plane] : picture.transmittance) + (int64_t)y * picture.stride + x, 4);
        hash = (hash ^ bits) * 0x100000001B3u;
      }
  return hash;
}

static void draw_fresh(pags_tasks *tasks, scene *s, pags_early_z mode, uint64_t hashes[CAMERAS], int *in_slabs) {
  for (int i = 0; i < CAMERAS; i++) {
    pags_frame *frame;
    assert_int_equal(pags_frame_create(tasks, &frame), PAGS_OK);
    hashes[i] = draw_one(frame, s, i, mode, in_slabs);
    pags_frame_destroy(frame);
  }
}

/* The state that a frame keeps from the previous frame changes no bit: cameras forwards, backwards, shuffled and
 * alternating, and an edited scene, give the pictures of fresh frames. */
static void test_sequences(void **unused) {
  (void)unused;
  scene s;
  uint64_t off[CAMERAS], want[CAMERAS];
  int shuffled[CAMERAS], at_once = 0, in_slabs = 0;
  state = 53;
  scene_create(&s, OPAQUE_WALLS, 9000);
  s.camera.width = 40, s.camera.height = 30, s.camera.fx = s.camera.fy = 25, s.camera.cx = 20, s.camera.cy = 15;
  s.options.extra_channels = 0;
  for (int i = 0; i < CAMERAS; i++) {
    const int j = below(i + 1);
    shuffled[i] = shuffled[j];
    shuffled[j] = i;
  }
  pags_tasks *const tasks = pags_tasks_create(2);
  pags_frame *frames[2];
  for (int f = 0; f < 2; f++)
    assert_int_equal(pags_frame_create(tasks, &frames[f]), PAGS_OK);
  for (int edit = 0; edit < 2; edit++) {
    for (int64_t i = 0; edit && i < s.gaussians[0].count; i += 3)
      put(&s.gaussians[0], i, PAGS_OPACITY, -6);
    draw_fresh(tasks, &s, PAGS_EARLY_Z_OFF, off, &at_once);
    for (pags_early_z mode = PAGS_EARLY_Z_LOSSLESS; mode <= (edit ? PAGS_EARLY_Z_LOSSLESS : PAGS_EARLY_Z_BOUNDED);
         mode++) {
      draw_fresh(tasks, &s, mode, want, &at_once);
      assert_true(mode == PAGS_EARLY_Z_BOUNDED || memcmp(off, want, sizeof off) == 0);
      for (int order = 0; order < (edit ? 1 : ORDERS); order++)
        for (int i = 0; i < CAMERAS; i++) {
          const int camera = order == 1 ? CAMERAS - 1 - i : order >= 2 ? shuffled[i] : i;
          const uint64_t got = draw_one(frames[order == 3 ? i % 2 : 0], &s, camera, mode, &in_slabs);
          if (got != want[camera])
            fail_msg("edit %d, mode %d, order %d: camera %d has other bits than alone", edit, (int)mode, order, camera);
        }
    }
  }
  print_message("%d frames in slabs after others, %d of those alone\n", in_slabs, at_once);
  assert_true(in_slabs > CAMERAS && at_once == 0);
  for (int f = 0; f < 2; f++)
    pags_frame_destroy(frames[f]);
  pags_tasks_destroy(tasks);
  scene_destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_parse),         cmocka_unit_test(test_every_recipe),
      cmocka_unit_test(test_random_scenes), cmocka_unit_test(test_bound_is_of_the_picture),
      cmocka_unit_test(test_padding),       cmocka_unit_test(test_first_of_many),
      cmocka_unit_test(test_choice),        cmocka_unit_test(test_sequences),
      cmocka_unit_test(test_steady),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
