/* SPDX-License-Identifier: Apache-2.0 */
/* Tests lenses, with a global and with a rolling shutter: formulas, frames and gradients are compared with the oracle,
 * which computes them independently, and the affine projection with rays through the lens. Also tests culling. */
#include "unit/random_scene.h"
#include "unit/scratch.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>

static const double pi = 3.14159265358979323846;

/* One lens of each kind, in a picture of WIDTH x HEIGHT. */
static const struct lens_case {
  const char *name;
  double focal; /* focal length as a share of the width */
  pags_lens_model lens;
} cases[] = {
    {"fisheye of 200 degrees", 0.30, {.kind = PAGS_LENS_FISHEYE, .k = {-0.06, 0.012, -0.0006}, .field = 200}},
    {"perspective", 0.6, {.kind = PAGS_LENS_PERSPECTIVE, .k = {-0.15, 0.03}, .p = {0.002, -0.003}}},
    {"rational", 0.6, {.kind = PAGS_LENS_RATIONAL, .k = {0.3, 0.1, 0.01}, .d = {0.5, 0.1, 0.02}, .p = {0.001, 0.002}}},
    {"f-theta", 0.35, {.kind = PAGS_LENS_FTHETA, .k = {0.01, -0.03, 0.002}, .s = {0.01, 0.005, -0.004}, .field = 190}},
    {"equirectangular", 0.5 / 3.14159265358979323846, {.kind = PAGS_LENS_EQUIRECTANGULAR}},
    {"thin prism", 0.4, {.kind = PAGS_LENS_THIN_PRISM, .k = {0.02, -0.01}, .p = {0.001, 0.002}, .s = {0.003, 0.002}}},
    {"aria", 0.4, {.kind = PAGS_LENS_ARIA, .k = {0.02, -0.01, 0.001}, .p = {0.001, 0.002}, .s = {0.003, 0, 0.002, 0}}},
    {"fov", 0.5, {.kind = PAGS_LENS_FOV, .k = {0.9}}},
    {"division", 0.6, {.kind = PAGS_LENS_DIVISION, .k = {-0.2}}},
    {"eucm", 0.5, {.kind = PAGS_LENS_EUCM, .k = {0.6, 1.1}}}};
enum { CASES = sizeof cases / sizeof *cases, PARTS = 2 };

typedef struct lens_scene {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part parts[PARTS];
} lens_scene;

static pags_camera camera_of(const struct lens_case *c, reference_random *random) {
  pags_camera camera = reference_random_camera(random, WIDTH, HEIGHT);
  camera.lens = c->lens;
  camera.fx = c->focal * WIDTH;
  camera.fy = c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? HEIGHT / pi : camera.fx * 1.02;
  camera.cx = 0.5 * WIDTH + (c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 0 : 1.3);
  camera.cy = 0.5 * HEIGHT - (c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 0 : 0.7);
  assert_int_equal(pags_camera_check(&camera, "test"), PAGS_OK);
  return camera;
}

/* Makes Gaussians all around the camera, more of them in its viewing direction. */
static lens_scene make(const struct lens_case *c, uint64_t seed, int count, int sh_degree,
                       const reference_recipe *recipe) {
  lens_scene s = {.random = {seed}, .options = reference_options()};
  s.options.extra_channels = 1;
  s.options.background[1] = 0.5f;
  s.camera = camera_of(c, &s.random);
  for (int p = 0; p < PARTS; p++) {
    reference_part *const part = &s.parts[p];
    *part = reference_part_create(count, sh_degree);
    part->first_id = p * count;
    reference_random_pose(&s.random, 3, part->world_from_model);
    const reference_view view = reference_view_of(part, &s.camera, &s.options);
    for (int64_t i = 0; i < count; i++) {
      double ray[3];
      reference_random_gaussian(&s.random, recipe, &s.camera, &s.options, part, i);
      const double x = reference_uniform(&s.random, -0.1, 1.1) * WIDTH,
                   y = reference_uniform(&s.random, -0.1, 1.1) * HEIGHT;
      if (i % 8 == 0 || !reference_lens_ray(&s.camera, x, y, ray))
        for (int k = 0; k < 3; k++)
          ray[k] = reference_normal(&s.random);
      const double depth = reference_uniform(&s.random, recipe->depth[0], recipe->depth[1]);
      const double length = sqrt(ray[0] * ray[0] + ray[1] * ray[1] + ray[2] * ray[2]);
      for (int k = 0; k < 3; k++) {
        double mean = 0;
        for (int row = 0; row < 3; row++)
          mean += view.rotation[3 * row + k] * (ray[row] * depth / length - view.translation[row]);
        part->planes[(PAGS_MEAN + k) * count + i] = mean;
      }
    }
    frame_scene_round(part);
  }
  return s;
}

/* Lets the camera and the second part move, by about `speed` metres during a read-out, up to a twentieth as many
 * radians a metre, in one of the directions of a panorama, which are those down, or in any of four. */
static void roll(lens_scene *s, int direction, double speed) {
  static const char *const directions[] = {"top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left"};
  const double seconds = 0.05;
  const int ways = s->camera.lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 2 : 4;
  assert_true(pags_shutter_set(&s->camera.shutter, directions[direction % ways], seconds));
  for (int k = 0; k < 6; k++) {
    const double most = (k < 3 ? 0.05 : 1) * speed / seconds;
    s->camera.shutter.velocity[k] = reference_uniform(&s->random, -most, most);
    s->parts[1].velocity[k] = reference_uniform(&s->random, -most, most);
  }
}

static void destroy(lens_scene *s) {
  for (int p = 0; p < PARTS; p++)
    reference_part_destroy(&s->parts[p]);
}

static frame_result draw(const lens_scene *s, int threads, int cluster_size, uint64_t shuffle_seed) {
  engine e = engine_create(threads);
  frame_scene scene = frame_scene_create(s->parts, PARTS, cluster_size, shuffle_seed);
  frame_result result = frame_run(e.frame, &scene, &s->camera, &s->options, NULL);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  return result;
}

/* ---- Formulas ---- */

static void test_formulas(void **state) {
  (void)state;
  reference_random random = {11};
  for (int c = 0; c < CASES; c++) {
    const pags_camera camera = camera_of(cases + c, &random);
    const double widest = fmin(pags_lens_model_widest(&camera.lens), pi - 0.1);
    int seen = 0;
    for (int i = 0; i < 500; i++) {
      const double angle = widest * reference_uniform(&random, 0, 0.99), turn = reference_uniform(&random, 0, 2 * pi);
      const double length = exp(reference_uniform(&random, -3, 3));
      double v[3] = {length * sin(angle) * cos(turn), length * sin(angle) * sin(turn), length * cos(angle)};
      if (i == 0)
        v[0] = v[1] = 0, v[2] = length;
      double pixel[2], want[2], j[6], slopes[6], back[3];
      assert_true(fabs(pags_lens_angle(v) - (i ? angle : 0)) < 1e-12);
      assert_true(pags_camera_project(&camera, v, pixel, j));
      reference_lens_pixel(&camera, v, want);
      reference_lens_jacobian(&camera, v, slopes);
      for (int k = 0; k < 2; k++)
        if (!(fabs(pixel[k] - want[k]) < 1e-9 * (1 + fabs(want[k]))))
          fail_msg("%s, angle %g: %.12g, should be %.12g", cases[c].name, angle, pixel[k], want[k]);
      const double far = sqrt(v[0] * v[0] + v[2] * v[2]) / length; /* distance from the poles */
      const bool seam = v[2] < 0 && fabs(v[0]) < 0.1 * length;
      const bool regular =
          angle > 0.02 && i > 0 && (camera.lens.kind != PAGS_LENS_EQUIRECTANGULAR || (far > 0.1 && !seam));
      for (int k = 0; k < 6 && regular; k++)
        if (!(fabs(j[k] - slopes[k]) < 1e-5 * camera.fx / length + 1e-6 * fabs(slopes[k])))
          fail_msg("%s, angle %g, derivative %d: %.9g, should be %.9g", cases[c].name, angle, k, j[k], slopes[k]);
      assert_true(pags_camera_look(&camera, pixel[0], pixel[1], back));
      for (int k = 0; k < 3; k++)
        if (!(fabs(back[k] - v[k] / length) < 1e-8))
          fail_msg("%s, angle %g, coordinate %d looked at: %.12g, should be %.12g", cases[c].name, angle, k, back[k],
                   v[k] / length);
      seen++;
    }
    assert_int_equal(seen, 500);
  }
}

/* A camera with a circular picture sees nothing outside of the circle. */
static void test_outside(void **state) {
  (void)state;
  reference_random random = {12};
  const pags_camera camera = camera_of(cases, &random);
  const double behind[3] = {0.1, 0, -1}, beside[3] = {1, 0, -0.16}, edge[3] = {1, 0, -0.18};
  double pixel[2], direction[3];
  assert_false(pags_camera_project(&camera, behind, pixel, NULL));
  assert_true(pags_camera_project(&camera, beside, pixel, NULL));
  assert_false(pags_camera_project(&camera, edge, pixel, NULL));
  assert_false(pags_camera_look(&camera, 0, 0, direction));
  assert_true(pags_camera_look(&camera, 0.5 * WIDTH, 0, direction));
}

static void test_file(void **state) {
  reference_random random = {13};
  pags_camera all[CASES];
  for (int c = 0; c < CASES; c++) {
    all[c] = camera_of(cases + c, &random);
    all[c].shutter.down = c % 2 ? 0.03 : 0;
  }
  const pags_camera_path path = {30, CASES, all};
  pags_camera_path back;
  assert_int_equal(pags_camera_path_save(scratch_path(*state, "lenses.json"), &path), PAGS_OK);
  assert_int_equal(pags_camera_path_load(scratch_path(*state, "lenses.json"), &back), PAGS_OK);
  assert_int_equal(back.count, CASES);
  for (int c = 0; c < CASES; c++) {
    const pags_lens_model *a = &all[c].lens, *b = &back.cameras[c].lens;
    assert_true(a->kind == b->kind && a->field == b->field && a->limit == b->limit);
    assert_true(back.cameras[c].shutter.down == all[c].shutter.down);
    assert_memory_equal(a->k, b->k, sizeof a->k);
    assert_memory_equal(a->d, b->d, sizeof a->d);
    assert_memory_equal(a->p, b->p, sizeof a->p);
    assert_memory_equal(a->s, b->s, sizeof a->s);
  }
  pags_camera_path_destroy(&back);
  pags_camera wide = all[0];
  wide.lens.field = 400;
  assert_int_equal(pags_camera_check(&wide, "it"), PAGS_ERROR_FORMAT);
}

/* ---- Pictures ---- */

/* The engine differs from the oracle by rounding, except where rounding may change a decision. Outside of a fisheye's
 * circle the picture is empty. */
static void test_engine_is_the_oracle(void **state) {
  (void)state;
  const reference_recipe recipe = reference_recipe_default();
  for (int k = 0; k < 3 * CASES; k++) {
    lens_scene s = make(cases + k % CASES, 100 + (uint64_t)k, 150, 3, &recipe);
    s.options.antialiased = k / CASES == 1;
    pags_sky sky = reference_random_sky(&s.random, 4);
    s.options.sky = k / CASES ? &sky : NULL;
    if (k / CASES == 2)
      roll(&s, k, 0.3);
    reference_picture exact = reference_render(s.parts, PARTS, &s.camera, &s.options);
    frame_result drawn = draw(&s, 2, 16, (uint64_t)k);
    int compared = 0, shown = 0;
    for (int pixel = 0; pixel < PIXELS; pixel++) {
      /* Around the poles of longitude and latitude derivatives grow without limit, and so does rounding. */
      const bool polar = exact.turn > 0 && (pixel / WIDTH < HEIGHT / 6 || pixel / WIDTH > HEIGHT * 5 / 6);
      if (exact.margin[pixel] < 1e-3 || exact.depth_margin[pixel] < 1e-5 || polar)
        continue;
      compared++;
      shown += exact.id[pixel] >= 0;
      for (int channel = 0; channel < 3; channel++) {
        const double want = exact.rgb[channel * PIXELS + pixel];
        if (!(fabs((double)drawn.rgb[channel * PIXELS + pixel] - want) < 1e-3))
          fail_msg("%s, pixel %d, %d: %g, should be %g", cases[k % CASES].name, pixel % WIDTH, pixel / WIDTH,
                   (double)drawn.rgb[channel * PIXELS + pixel], want);
      }
      assert_true(fabs((double)drawn.depth[pixel] - exact.depth[pixel]) < 2e-3 * fmax(1, exact.depth[pixel]));
    }
    print_message("  %-24s %d of %d pixels compared, %d with Gaussians\n", cases[k % CASES].name, compared, PIXELS,
                  shown);
    assert_true(compared > PIXELS / 2 && shown > PIXELS / 4);
    frame_result_destroy(&drawn);
    reference_picture_destroy(&exact);
    free(sky.texels);
    destroy(&s);
  }
}

/* The number of threads, clusters and their order change no bit, nor does drawing in slabs: the bounds by which
 * clusters are culled hold. Gaussians have unequal sizes, and many lie just outside of the picture. */
static void test_bits(void **state) {
  (void)state;
  reference_recipe recipe = reference_recipe_default();
  recipe.spread = 3;
  recipe.sigma[1] = 20;
  recipe.depth[0] = 0.02;
  for (int k = 0; k < 2 * CASES; k++) {
    lens_scene s = make(cases + k % CASES, 400 + (uint64_t)k, 700, 2, &recipe);
    if (k / CASES)
      roll(&s, k, k % 3 ? 0.5 : 3);
    s.options.early_z = PAGS_EARLY_Z_OFF;
    frame_result first = draw(&s, 1, 16, 0);
    const uint64_t expected = frame_result_hash(&first);
    int shown = 0;
    for (int pixel = 0; pixel < PIXELS; pixel++)
      shown += first.id[pixel] >= 0;
    assert_true(shown > PIXELS / 4);
    frame_result_destroy(&first);
    for (int n = 0; n < 4; n++) {
      const int sizes[] = {256, 64, 16, 32};
      s.options.early_z = n < 2 ? PAGS_EARLY_Z_OFF : PAGS_EARLY_Z_LOSSLESS;
      s.options.slab_size = n < 2 ? 0 : 50 * n;
      frame_result result = draw(&s, n + 1, sizes[n], (uint64_t)n);
      if (frame_result_hash(&result) != expected)
        fail_msg("%s: other bits with clusters of %d", cases[k % CASES].name, sizes[n]);
      frame_result_destroy(&result);
    }
    destroy(&s);
  }
}

/* A scene of clusters of sixteen small neighbours, most of which are culled, gives the same picture as mixed
 * clusters that are drawn whole. A bound that is too narrow would lose a cluster. */
static void test_culling(void **state) {
  (void)state;
  enum { CLUMP = 16, CLUMPS = 40, COUNT = CLUMP * CLUMPS };
  reference_recipe recipe = reference_recipe_default();
  recipe.sigma[0] = 0.2;
  recipe.sigma[1] = 3;
  for (int k = 0; k < CASES; k++)
    for (uint64_t seed = 0; seed < 4; seed++) {
      lens_scene s = make(cases + k, 900 + seed, COUNT, 0, &recipe);
      for (int p = 0; p < PARTS; p++)
        for (int i = 0; i < COUNT; i++)
          for (int plane = PAGS_MEAN; plane < PAGS_MEAN + 3; plane++) {
            double *const values = s.parts[p].planes + plane * COUNT, middle = values[i / CLUMP * CLUMP];
            values[i] = middle + (i % CLUMP ? reference_uniform(&s.random, -0.15, 0.15) : 0);
          }
      for (int p = 0; p < PARTS; p++)
        frame_scene_round(&s.parts[p]);
      if (seed > 1)
        roll(&s, k, 0.5);
      s.camera.cx += 20.0 * (double)seed,
          s.camera.cy -= 15.0 * (double)seed; /* only a part of the circle is in the picture */
      engine e = engine_create(1);
      int64_t in_view[2];
      uint64_t hashes[2];
      for (int n = 0; n < 2; n++) {
        frame_scene scene = frame_scene_create(s.parts, PARTS, n ? 256 : CLUMP, n ? 5 : 0);
        frame_result result = frame_run(e.frame, &scene, &s.camera, &s.options, NULL);
        in_view[n] = pags_frame_stats_get(e.frame)->in_view;
        hashes[n] = frame_result_hash(&result);
        frame_result_destroy(&result);
        frame_scene_destroy(&scene);
      }
      if (s.camera.lens.kind != PAGS_LENS_EQUIRECTANGULAR)
        assert_true(in_view[0] < in_view[1]);
      if (hashes[0] != hashes[1])
        fail_msg("%s, seed %d: other bits", cases[k].name, (int)seed);
      engine_destroy(&e);
      destroy(&s);
    }
}

static double rms(const double *a, const double *b) {
  double sum = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    sum += (a[k] - b[k]) * (a[k] - b[k]);
  return sqrt(sum / (3 * PIXELS));
}

/* The projections by derivatives at the mean and by sigma points are compared with the largest density along each
 * pixel's ray. */
static void test_rays(void **state) {
  (void)state;
  static const double sizes[][2] = {{0.3, 1}, {1, 3}, {3, 8}};
  enum { SIZES = 3, SEEDS = 4 };
  for (int k = 0; k < 5 * SIZES; k++) {
    const int n = k % SIZES;
    double all[2] = {0, 0};
    for (int seed = 0; seed < SEEDS; seed++) {
      reference_recipe recipe = reference_recipe_default();
      memcpy(recipe.sigma, sizes[n], sizeof recipe.sigma);
      lens_scene s = make(cases + k / SIZES, 700 + (uint64_t)seed, 60, 0, &recipe);
      reference_limits limits = REFERENCE_LIMITS;
      reference_picture by_slopes = reference_render_within(limits, s.parts, PARTS, &s.camera, &s.options);
      limits.sigma_points = 1;
      reference_picture by_points = reference_render_within(limits, s.parts, PARTS, &s.camera, &s.options);
      double *rays = reference_ray_picture(s.parts, PARTS, &s.camera, &s.options, &by_slopes);
      const double slopes = rms(by_slopes.rgb, rays), points = rms(by_points.rgb, rays);
      all[0] += slopes / SEEDS, all[1] += points / SEEDS;
      free(rays);
      reference_picture_destroy(&by_slopes);
      reference_picture_destroy(&by_points);
      destroy(&s);
    }
    print_message("  %-24s sigma %3.1f to %1.0f px: error by derivatives %.5f, by sigma points %.5f\n",
                  cases[k / SIZES].name, sizes[n][0], sizes[n][1], all[0], all[1]);
    if (n == 0)
      assert_true(all[0] < (k / SIZES == 4 ? 0.03 : 0.003));
  }
}

/* The picture by definition: each line is that of rays through a camera with a global shutter at the line's time. Of
 * small Gaussians a few per cent of the error of a global shutter remain. */
static void test_line_by_line(void **state) {
  (void)state;
  reference_recipe recipe = reference_recipe_default();
  recipe.sigma[0] = 0.3, recipe.sigma[1] = 1;
  for (int k = 0; k < 5; k++) {
    lens_scene s = make(cases + k, 1200 + (uint64_t)k, 60, 1, &recipe);
    roll(&s, k, 0.15);
    const bool down = s.camera.shutter.down != 0;
    double *truth = reference_alloc(3 * PIXELS, sizeof(double)), *shown[2];
    for (int line = 0; line < (down ? HEIGHT : WIDTH); line++) {
      reference_part parts[PARTS];
      reference_moment moment = {0};
      for (int p = 0; p < PARTS; p++) {
        moment = reference_moment_at(&s.parts[p], &s.camera, pags_camera_read_at(&s.camera, line + 0.5, line + 0.5));
        parts[p] = moment.part;
      }
      reference_picture picture = reference_render(parts, PARTS, &moment.camera, &s.options);
      double *rays = reference_ray_picture(parts, PARTS, &moment.camera, &s.options, &picture);
      for (int i = 0; i < 3 * PIXELS; i++)
        if ((down ? i % PIXELS / WIDTH : i % WIDTH) == line)
          truth[i] = rays[i];
      free(rays);
      reference_picture_destroy(&picture);
    }
    for (int n = 0; n < 2; n++) {
      frame_result drawn = draw(&s, 1, 16, 0);
      shown[n] = reference_alloc(3 * PIXELS, sizeof(double));
      for (int i = 0; i < 3 * PIXELS; i++)
        shown[n][i] = (double)drawn.rgb[i];
      frame_result_destroy(&drawn);
      s.camera.shutter = (pags_shutter){0};
    }
    const double with = rms(shown[0], truth), without = rms(shown[1], truth);
    print_message("  %-24s error %.5f, with a global shutter %.5f\n", cases[k].name, with, without);
    assert_true(cases[k].lens.kind == PAGS_LENS_EQUIRECTANGULAR ? with < without : with < 0.1 * without);
    free(shown[0]);
    free(shown[1]);
    free(truth);
    destroy(&s);
  }
}

/* ---- Gradients ---- */

static double loss(const lens_scene *s, const double *weights) {
  reference_picture picture = reference_render(s->parts, PARTS, &s->camera, &s->options);
  double sum = 0;
  for (int k = 0; k < 3 * PIXELS; k++)
    sum += weights[k] * picture.rgb[k];
  for (int k = 0; k < PIXELS; k++)
    sum += weights[3 * PIXELS + k] * picture.transmittance[k] + weights[4 * PIXELS + k] * picture.depth_sum[k];
  reference_picture_destroy(&picture);
  return sum;
}

/* Compares the engine's gradients with central differences of the oracle. Pixels at which the oracle decides
 * differently have no weight. */
static void check_gradients(const struct lens_case *c, uint64_t seed, bool antialiased, bool rolls) {
  enum { COUNT = 5, DEGREE = 1 };
  const double step = 1e-5;
  reference_recipe recipe = reference_recipe_default();
  if (c->lens.kind != PAGS_LENS_EQUIRECTANGULAR)
    recipe.sigma[0] = 3;
  else
    recipe.sigma[0] = 0.5, recipe.sigma[1] = 1.5;
  lens_scene s = make(c, seed, COUNT, DEGREE, &recipe);
  s.options.antialiased = antialiased;
  if (rolls) /* where derivatives grow without limit, more slowly: the engine's poses lie on a parabola */
    roll(&s, (int)seed, c->lens.kind == PAGS_LENS_EQUIRECTANGULAR ? 0.1 : 0.3);
  double *weights = reference_alloc(5 * PIXELS, sizeof(double));
  reference_picture picture = reference_render(s.parts, PARTS, &s.camera, &s.options);
  for (int k = 0; k < 5 * PIXELS; k++) {
    const int pixel = k % PIXELS;
    double ray[3];
    /* An equirectangular picture is trained without the columns next to its seam. */
    const bool aside = c->lens.kind == PAGS_LENS_EQUIRECTANGULAR && (pixel % WIDTH < 25 || pixel % WIDTH > WIDTH - 25);
    const bool near = picture.margin[pixel] < 1e-2 || picture.depth_margin[pixel] < 1e-3 || aside ||
                      !reference_lens_ray(&s.camera, pixel % WIDTH + 0.5, pixel / WIDTH + 0.5, ray);
    weights[k] = near ? 0 : (double)(float)reference_uniform(&s.random, -1, 1);
  }
  engine e = engine_create(2);
  frame_scene scene = frame_scene_create(s.parts, PARTS, 16, 0);
  const reference_picture_gradient gradient = {weights, weights + 3 * PIXELS, weights + 4 * PIXELS, NULL};
  frame_result drawn = frame_run(e.frame, &scene, &s.camera, &s.options, &gradient);
  int checked = 0;
  double worst = 0;
  for (int64_t i = 0, all = PARTS * COUNT; i < all; i++) {
    const int p = (int)(i / COUNT);
    reference_part *const part = &s.parts[p];
    const reference_splat *const splat = &picture.splats[i];
    const double wide = 3.4 * sqrt(splat->cov[0]);
    if (!splat->drawn || splat->margin < 1e-3 ||
        (picture.turn > 0 && (splat->mean2d[0] < wide || splat->mean2d[0] > WIDTH - wide)))
      continue;
    static const int first[] = {PAGS_MEAN,    PAGS_SCALE, PAGS_ROTATION,
                                PAGS_OPACITY, PAGS_SH,    PAGS_SH + 3 * (DEGREE + 1) * (DEGREE + 1)};
    for (int group = 0; group < 5; group++) {
      double norm = 0, off = 0;
      for (int plane = first[group]; plane < first[group + 1]; plane++) {
        double *const value = part->planes + plane * COUNT + i % COUNT, kept = *value, around[4];
        for (int k = 0; k < 4; k++) {
          *value = kept + step * (double)(k < 2 ? k - 2 : k - 1);
          around[k] = loss(&s, weights);
        }
        *value = kept;
        const double want = (8 * (around[2] - around[1]) - (around[3] - around[0])) / (12 * step);
        const double got = (double)drawn.parts[p].planes[plane * COUNT + i % COUNT];
        norm += want * want;
        off += (got - want) * (got - want);
      }
      if (!(sqrt(off) < 2e-3 * sqrt(norm) + 2e-3))
        fail_msg("%s, seed %d, Gaussian %d, planes from %d: off by %g of %g", c->name, (int)seed, (int)i, first[group],
                 sqrt(off), sqrt(norm));
      worst = norm > 1 ? fmax(worst, sqrt(off / norm)) : worst;
      checked += norm > 1e-4;
    }
  }
  print_message("  %-24s %s shutter: %d groups of gradients, off by %.1e at most\n", c->name,
                rolls ? "rolling" : "global", checked, worst);
  assert_true(checked > 10);
  frame_result_destroy(&drawn);
  frame_scene_destroy(&scene);
  engine_destroy(&e);
  reference_picture_destroy(&picture);
  free(weights);
  destroy(&s);
}

static void test_gradients(void **state) {
  (void)state;
  for (int k = 0; k < 12; k++)
    check_gradients(cases + k % 6, 500 + (uint64_t)k, k % 2, k / 6);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_formulas),  cmocka_unit_test(test_outside),
      scratch_test(test_file),          cmocka_unit_test(test_engine_is_the_oracle),
      cmocka_unit_test(test_bits),      cmocka_unit_test(test_culling),
      cmocka_unit_test(test_rays),      cmocka_unit_test(test_line_by_line),
      cmocka_unit_test(test_gradients),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
