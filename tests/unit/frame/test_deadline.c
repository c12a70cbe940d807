/* SPDX-License-Identifier: Apache-2.0 */
/* Tests rendering within a time budget: the controller with a simulated clock, and the effects of each quality
 * reduction. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <math.h>
#include <pags/deadline.h>
#include <stdbool.h>

/* ---- The controller ---- */

typedef struct clock_model {
  /* True cost of each reduction step as a share of the full frame's cost; the controller doesn't know them. */
  double share[PAGS_DEADLINE_STEPS];
  double noise;
  unsigned state;
} clock_model;

static double noise_of(clock_model *m) {
  m->state = m->state * 1664525u + 1013904223u;
  return 1 + m->noise * ((double)(m->state >> 8) / 8388608.0 - 1);
}

static const clock_model steep = {{1, 0.95, 0.85, 0.7, 0.5, 0.35, 0.2, 0.1, 0.09, 0.06, 0.04, 0.03}, 0.04, 1};

/* Simulates frames whose full cost varies between `low` and `high` milliseconds with a period of 60 frames. Returns
 * the share of frames that met the target, and the mean reduction step. */
static double drive(pags_deadline_controller *c, clock_model m, double low, double high, int frames,
                    double *mean_step) {
  int met = 0, sum = 0;
  for (int i = 0; i < frames; i++) {
    const double full = low + (high - low) * 0.5 * (1 + sin(i * 6.28318 / 60)),
                 ms = full * m.share[c->step] * noise_of(&m);
    met += ms <= c->target;
    sum += c->step;
    pags_deadline_controller_tell(c, ms);
  }
  *mean_step = (double)sum / frames;
  return (double)met / frames;
}

static void test_nothing_is_given_up_for_nothing(void **state) {
  (void)state;
  double step;
  pags_deadline_controller c = pags_deadline_controller_begin(50);
  assert_true(drive(&c, steep, 20, 40, 200, &step) == 1);
  assert_true(step == 0);
}

static void test_the_time_is_kept(void **state) {
  (void)state;
  const double costs[][2] = {{50, 60}, {60, 120}, {80, 250}, {200, 300}, {30, 90}};
  for (int i = 0; i < 5; i++) {
    double first, step, later;
    pags_deadline_controller c = pags_deadline_controller_begin(50);
    drive(&c, steep, costs[i][0], costs[i][1], 30, &first); /* the controller learns the costs */
    assert_true(drive(&c, steep, costs[i][0], costs[i][1], 400, &step) >= 0.95);
    /* Quality isn't reduced more than needed: the mean step is at most 1.5 above that of a controller that knows all
     * costs. */
    double wanted = 0;
    for (int k = 0; k < 400; k++) {
      const double full = costs[i][0] + (costs[i][1] - costs[i][0]) * 0.5 * (1 + sin(k * 6.28318 / 60));
      int j = 0;
      while (j + 1 < PAGS_DEADLINE_STEPS && full * steep.share[j] > 50)
        j++;
      wanted += j / 400.0;
    }
    assert_true(step <= wanted + 1.5);
    drive(&c, steep, 10, 20, 100, &later); /* on cheap frames full quality comes back */
    assert_int_equal(c.step, 0);
  }
}

static void test_the_impossible(void **state) {
  (void)state;
  double step;
  pags_deadline_controller c = pags_deadline_controller_begin(5);
  assert_true(drive(&c, steep, 100, 200, 100, &step) == 0);
  assert_int_equal(c.step, PAGS_DEADLINE_WHOLE_STEPS - 1); /* a picture that is kept for later has full size */
  pags_deadline_controller_tell(&c, NAN);
  pags_deadline_controller_tell(&c, 0);
  pags_deadline_controller_tell(&c, INFINITY);
  assert_int_equal(c.step, PAGS_DEADLINE_WHOLE_STEPS - 1);
}

/* For frames shown live, Early-Z is bounded in every frame, and frames become smaller if nothing else meets the
 * deadline. */
static void test_live(void **state) {
  (void)state;
  double step;
  pags_deadline_controller c = pags_deadline_controller_begin_live(50);
  assert_true(pags_deadline_steps()[c.step].divisor == 2); /* the costs aren't known yet */
  pags_deadline_controller_tell(&c, 2);
  assert_int_equal(c.step, 1); /* full size at once, since the first step was a guess */
  drive(&c, steep, 20, 40, 30, &step);
  assert_true(drive(&c, steep, 20, 40, 200, &step) == 1 && step == 1);
  c = pags_deadline_controller_begin_live(5);
  drive(&c, steep, 60, 80, 30, &step);
  assert_true(drive(&c, steep, 60, 80, 200, &step) >= 0.95 && step > PAGS_DEADLINE_WHOLE_STEPS);
  drive(&c, steep, 1000, 1100, 30, &step);
  assert_int_equal(c.step, PAGS_DEADLINE_STEPS - 1);
}

/* Counts the changes of step over `frames` frames of steady cost, with one frame in `spike_every` (0: none) that takes
 * three times as long. *met: frames within the target, spikes left out. */
static int steady(pags_deadline_controller *c, clock_model m, double full, int frames, int spike_every, int *met) {
  int changes = 0;
  *met = 0;
  for (int i = 0; i < frames; i++) {
    const bool spike = spike_every && i % spike_every == spike_every - 1;
    const int step = c->step;
    const double ms = full * m.share[step] * noise_of(&m);
    *met += spike || ms <= c->target;
    pags_deadline_controller_tell(c, spike ? 3 * ms : ms);
    changes += c->step != step;
  }
  return changes;
}

/* For any cost the step becomes constant; single frames that another program delays don't change it. */
static void test_no_oscillation(void **state) {
  (void)state;
  for (double full = 30; full < 400; full *= 1.07)
    for (int spikes = 0; spikes <= 37; spikes += 37) {
      int met;
      pags_deadline_controller c = pags_deadline_controller_begin(50);
      steady(&c, steep, full, 40, 0, &met);
      assert_true(steady(&c, steep, full, 300, spikes, &met) <= 6);
      assert_true(met >= 294);
    }
}

/* A scene that gets slower, gradually or suddenly: frames meet the deadline again after a number of frames. */
static void test_a_scene_that_gets_slower(void **state) {
  (void)state;
  int met;
  pags_deadline_controller c = pags_deadline_controller_begin(50);
  for (int i = 0; i < 10; i++)
    pags_deadline_controller_tell(&c, 42);
  assert_int_equal(c.step, 0);
  pags_deadline_controller_tell(&c, 48); /* in time, but the next frame may be late */
  assert_true(c.step > 0);
  c = pags_deadline_controller_begin(50);
  steady(&c, steep, 40, 50, 0, &met);
  assert_int_equal(c.step, 0);
  int kept = 0;
  for (double full = 40; full < 200; full *= 1.01) {
    int one;
    steady(&c, steep, full, 1, 0, &one);
    kept += one;
  }
  assert_true(kept >= 157); /* of 162 frames */
  steady(&c, steep, 40, 60, 0, &met);
  assert_int_equal(c.step, 0);
  steady(&c, steep, 160, 6, 0, &met); /* suddenly four times as slow */
  steady(&c, steep, 160, 100, 0, &met);
  assert_true(met >= 98);
}

/* If the caller's drawing makes pictures too rare, rendering gets less of the target time; later it gets more again. */
static void test_pace(void **state) {
  (void)state;
  int met;
  pags_deadline_controller c = pags_deadline_controller_begin_live(50);
  steady(&c, steep, 40, 30, 0, &met);
  assert_int_equal(c.step, 1);
  for (int i = 0; i < 60; i++) {
    pags_deadline_controller_pace(&c, 120, 95);
    steady(&c, steep, 40, 1, 0, &met);
  }
  assert_true(c.haste == 0.25 && 40 * steep.share[c.step] < 0.25 * 50);
  pags_deadline_controller_pace(&c, 3000, 95); /* a pause between two movements doesn't count */
  pags_deadline_controller_pace(&c, 90, 95);   /* the requested interval */
  assert_true(c.haste == 0.25);
  for (int i = 0; i < 60; i++) {
    pags_deadline_controller_pace(&c, 50, 95);
    steady(&c, steep, 40, 1, 0, &met);
  }
  assert_true(c.haste == 1 && c.step == 1);
}

/* ---- Frames ---- */

enum { WIDTH = 150, HEIGHT = 90, COUNT = 12000, CRITICAL = 900 };

typedef struct scene {
  pags_gaussians gaussians;
  pags_clusters clusters;
  pags_part part;
  pags_camera camera;
  pags_frame_options options;
  float priority[COUNT];
  pags_tasks *tasks;
  pags_frame *frame;
} scene;

static unsigned seed;
static float between(float lo, float hi) {
  seed = seed * 1664525u + 1013904223u;
  return lo + (hi - lo) * (float)(seed >> 8) / 16777216.0f;
}

static void put(const scene *s, int64_t i, const float mean[3], float sigma, float logit) {
  const pags_gaussians *const g = &s->gaussians;
  for (int k = 0; k < 3; k++) {
    pags_plane(g, PAGS_MEAN + k)[i] = mean[k];
    pags_plane(g, PAGS_SCALE + k)[i] = logf(sigma);
  }
  pags_plane(g, PAGS_ROTATION)[i] = 1;
  pags_plane(g, PAGS_OPACITY)[i] = logit;
  for (int p = PAGS_SH; p < pags_plane_count(g->sh_degree); p++)
    pags_plane(g, p)[i] = between(-0.4f, 0.6f);
}

/* A scene whose background fills the picture, 8 m away, with a critical object on the left, 4 m away. */
static void create(scene *s) {
  memset(s, 0, sizeof *s);
  seed = 5;
  assert_int_equal(pags_gaussians_create(&s->gaussians, COUNT, 1), PAGS_OK);
  assert_int_equal(pags_gaussians_add_s_sem(&s->gaussians), PAGS_OK);
  for (int64_t i = 0; i < COUNT; i++) {
    const int critical = i < CRITICAL;
    const float mean[3] = {critical ? between(-1.6f, -0.9f) : between(-6, 6),
                           critical ? between(-0.4f, 0.4f) : between(-4, 4), critical ? 4 : between(8, 9)};
    put(s, i, mean, critical ? 0.08f : between(0.005f, 0.2f), critical ? 3 : between(-4, 2));
    s->gaussians.s_sem[i] = s->priority[i] = critical ? 1 : 0;
  }
  assert_int_equal(pags_clusters_create(&s->clusters, COUNT, 16), PAGS_OK);
  pags_clusters_update(&s->clusters, &s->gaussians, 0, s->clusters.count);
  s->part = (pags_part){
      .gaussians = &s->gaussians, .clusters = &s->clusters, .world_from_model = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  s->camera = (pags_camera){.width = WIDTH,
                            .height = HEIGHT,
                            .fx = 100,
                            .fy = 100,
                            .cx = 75,
                            .cy = 45,
                            .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  s->options = pags_frame_options_default();
  s->options.extra_channels = 1;
  s->tasks = pags_tasks_create(2);
  assert_int_equal(pags_frame_create(s->tasks, &s->frame), PAGS_OK);
}

static void destroy(scene *s) {
  pags_frame_destroy(s->frame);
  pags_tasks_destroy(s->tasks);
  pags_gaussians_destroy(&s->gaussians);
  pags_clusters_destroy(&s->clusters);
}

static pags_picture draw(scene *s, const pags_frame_options *options) {
  pags_picture out;
  assert_int_equal(pags_frame_render(s->frame, &s->part, 1, &s->camera, options, NULL, NULL, &out), PAGS_OK);
  return out;
}

/* Counts the pixels of the marked tiles whose bits differ. */
static int differing(const pags_picture *a, const pags_picture *b, const uint8_t *tiles) {
  const int tiles_x = (WIDTH + 15) / 16;
  int count = 0;
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      const int64_t at = (int64_t)y * a->stride + x;
      if (!tiles[y / 16 * tiles_x + x / 16])
        continue;
      int differs = memcmp(a->transmittance + at, b->transmittance + at, 4) != 0 || a->id[at] != b->id[at] ||
                    memcmp(a->depth + at, b->depth + at, 4) != 0;
      for (int k = 0; k < 3; k++)
        differs |= memcmp(a->rgb[k] + at, b->rgb[k] + at, 4) != 0;
      count += differs;
    }
  return count;
}

static double psnr(const pags_picture *a, const pags_picture *b) {
  double sum = 0;
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++)
      for (int k = 0; k < 3; k++)
        sum += pow((double)a->rgb[k][(int64_t)y * a->stride + x] - (double)b->rgb[k][(int64_t)y * b->stride + x], 2);
  return -10 * log10(sum / (3.0 * WIDTH * HEIGHT) + 1e-12);
}

/* Cutting small Gaussians and lowering SH degrees applies to the background only, never to critical Gaussians. */
static void test_rest_is_cut(void **state) {
  (void)state;
  scene s;
  create(&s);
  draw(&s, &s.options);
  const int64_t all = pags_frame_stats_get(s.frame)->shaded;
  pags_frame_options options = s.options;
  options.rest_cut = 2;
  draw(&s, &options);
  const int64_t some = pags_frame_stats_get(s.frame)->shaded;
  assert_true(some < all && some > CRITICAL / 2);
  options.rest_cut = 1e9f;
  draw(&s, &options);
  assert_true(pags_frame_stats_get(s.frame)->shaded <= CRITICAL &&
              pags_frame_stats_get(s.frame)->shaded > CRITICAL / 2);
  options.rest_sh_less = 3;
  scene other; /* a scene with only the critical Gaussians visible */
  create(&other);
  for (int64_t i = CRITICAL; i < COUNT; i++)
    pags_plane(&other.gaussians, PAGS_OPACITY)[i] = -20;
  uint8_t all_tiles[1024];
  memset(all_tiles, 1, sizeof all_tiles);
  const pags_picture cut = draw(&s, &options), alone = draw(&other, &other.options);
  assert_int_equal(differing(&cut, &alone, all_tiles), 0);
  options = s.options;
  options.rest_sh_less = 1;
  pags_frame_options flat = s.options;
  flat.sh_degree = 0;
  for (int64_t i = 0; i < COUNT; i++)
    s.gaussians.s_sem[i] = 0;
  const pags_picture less = draw(&s, &options);
  pags_frame *frame;
  pags_picture degree0;
  assert_int_equal(pags_frame_create(s.tasks, &frame), PAGS_OK);
  assert_int_equal(pags_frame_render(frame, &s.part, 1, &s.camera, &flat, NULL, NULL, &degree0), PAGS_OK);
  assert_int_equal(differing(&less, &degree0, all_tiles), 0);
  pags_frame_destroy(frame);
  destroy(&s);
  destroy(&other);
}

/* Renders a frame with all reductions of the step except variable rate shading. */
static pags_picture draw_step(scene *s, int step) {
  const pags_deadline_step *const k = pags_deadline_steps() + step;
  pags_frame_options options = s->options;
  if (k->eps > 0) {
    options.early_z = PAGS_EARLY_Z_BOUNDED;
    options.early_z_eps = k->eps;
    options.exp_degree = 3;
  }
  options.rest_cut = k->cut;
  options.rest_sh_less = k->sh_less;
  return draw(s, &options);
}

/* Marks the tiles with a pixel in which a critical Gaussian has the largest blending weight. */
static void mark_critical(const pags_picture *whole, uint8_t *tiles) {
  const int tiles_x = (WIDTH + 15) / 16;
  memset(tiles, 0, 1024);
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      const int32_t id = whole->id[(int64_t)y * whole->stride + x];
      if (id >= 0 && id < CRITICAL)
        tiles[y / 16 * tiles_x + x / 16] = 1;
    }
}

static void test_steps(void **state) {
  (void)state;
  scene s, other;
  pags_deadline *budget;
  create(&s);
  create(&other);
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &budget), PAGS_OK);
  const pags_picture whole = draw(&s, &s.options);
  uint8_t tiles[1024], all_tiles[1024];
  memset(all_tiles, 1, sizeof all_tiles);
  mark_critical(&whole, tiles);
  for (int step = 0; step < PAGS_DEADLINE_WHOLE_STEPS; step++) {
    const int sampled = pags_deadline_steps()[step].sampled;
    pags_picture out;
    pags_deadline_result facts;
    assert_int_equal(pags_deadline_render_step(budget, step, &s.part, 1, &s.camera, &s.options, &out, &facts), PAGS_OK);
    const pags_picture full = draw_step(&other, step);
    /* Tiles of critical objects and around them have the bits of a frame shaded at every pixel, and so have all tiles
     * at steps without variable rate shading. */
    assert_int_equal(differing(&full, &out, sampled ? tiles : all_tiles), 0);
    if (sampled)
      assert_true(facts.full_tiles > 0.02 && facts.full_tiles < 0.5 &&
                  differing(&full, &out, all_tiles) > WIDTH * HEIGHT / 4);
    else
      assert_true(facts.full_tiles == 1);
    assert_true(psnr(&whole, &out) > 15 && psnr(&full, &out) > 22);
    for (int64_t i = 0; i < (int64_t)HEIGHT * out.stride; i++)
      assert_true(i % out.stride >= WIDTH ||
                  (isfinite(out.rgb[0][i]) && out.transmittance[i] >= 0 && out.transmittance[i] <= 1));
  }
  pags_deadline_destroy(budget);
  destroy(&s);
  destroy(&other);
}

/* A critical object just right of a tile's edge: the tile's last sample doesn't see it, but its last pixel does. */
static void test_neighbours_are_full(void **state) {
  (void)state;
  scene s, other;
  pags_deadline *budget;
  create(&s);
  create(&other);
  scene *const both[] = {&s, &other};
  /* Projects to x = 64.9 px at 4 m; the samples are at 62 px and 66 px. */
  const float right = (64.9f - 75) / 100 * 4;
  for (int k = 0; k < 2; k++) {
    for (int64_t i = 0; i < CRITICAL; i++)
      pags_plane(&both[k]->gaussians, PAGS_OPACITY)[i] = i == 0 ? 5 : -20;
    seed = 6;
    /* Half a pixel wide; the low-pass filter makes it 0.74 px. */
    put(both[k], 0, (const float[]){right, 0, 4}, 0.02f, 5);
    pags_plane(&both[k]->gaussians, PAGS_SCALE + 1)[0] = logf(0.6f);
    pags_clusters_update(&both[k]->clusters, &both[k]->gaussians, 0, both[k]->clusters.count);
  }
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &budget), PAGS_OK);
  uint8_t tiles[1024] = {0};
  tiles[2 * ((WIDTH + 15) / 16) + 3] = 1;
  for (int step = 5; step < PAGS_DEADLINE_WHOLE_STEPS; step++) {
    pags_picture out;
    pags_deadline_result facts;
    assert_int_equal(pags_deadline_render_step(budget, step, &s.part, 1, &s.camera, &s.options, &out, &facts), PAGS_OK);
    const pags_picture full = draw_step(&other, step);
    assert_int_equal(differing(&full, &out, tiles), 0);
    assert_true(facts.full_tiles < 0.4);
  }
  pags_deadline_destroy(budget);
  destroy(&s);
  destroy(&other);
}

/* Where the picture is linear, interpolation between the shaded samples reproduces it, up to half a sample from the
 * picture's edges; the same holds for the sky. */
static void test_samples_are_interpolated(void **state) {
  (void)state;
  scene s;
  pags_deadline *budget;
  float texels[6 * 3 * 4];
  create(&s);
  for (int64_t i = 0; i < COUNT; i++)
    pags_plane(&s.gaussians, PAGS_OPACITY)[i] = -20;
  put(&s, CRITICAL, (const float[]){0, -9, 10}, 8, -2); /* two large faint Gaussians; all others are transparent */
  put(&s, CRITICAL + 1, (const float[]){0, 9, 11}, 8, -2);
  pags_clusters_update(&s.clusters, &s.gaussians, 0, s.clusters.count);
  for (int i = 0; i < 72; i++)
    texels[i] = 0.3f + 0.01f * (float)(i % 5);
  const pags_sky sky = {.size = 2, .texels = texels};
  s.options.sky = &sky;
  s.options.exposed = 1;
  for (int k = 0; k < 3; k++)
    s.options.gain[k] = 1.2f, s.options.offset[k] = 0.05f;
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &budget), PAGS_OK);
  pags_picture out;
  pags_deadline_result facts;
  const pags_picture full = draw_step(&s, 5);
  assert_int_equal(pags_deadline_render_step(budget, 5, &s.part, 1, &s.camera, &s.options, &out, &facts), PAGS_OK);
  assert_true(facts.full_tiles == 0);
  for (int y = 2; y < HEIGHT - 2; y++)
    for (int x = 2; x < WIDTH - 2; x++)
      for (int k = 0; k < 3; k++) {
        const int64_t at = (int64_t)y * full.stride + x;
        assert_true(fabsf(full.rgb[k][at] - out.rgb[k][at]) < 2e-3f);
        assert_true(fabsf(full.transmittance[at] - out.transmittance[at]) < 2e-3f);
      }
  /* Ids are taken from the nearest sample: they may differ only within half a sample of where the id changes. */
  int64_t others = 0;
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++)
      others += full.id[(int64_t)y * full.stride + x] != out.id[(int64_t)y * full.stride + x];
  assert_true(full.id[0] == CRITICAL && full.id[(int64_t)(HEIGHT - 1) * full.stride] == CRITICAL + 1 &&
              others <= 2 * WIDTH);
  pags_deadline_destroy(budget);
  destroy(&s);
}

/* A smaller frame has the same field of view and the pixels of a camera of that size. */
static void test_smaller(void **state) {
  (void)state;
  scene s, other;
  pags_deadline *deadline;
  create(&s);
  create(&other);
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &deadline), PAGS_OK);
  for (int step = PAGS_DEADLINE_WHOLE_STEPS; step < PAGS_DEADLINE_STEPS; step++) {
    const double divisor = pags_deadline_steps()[step].divisor;
    pags_picture out;
    pags_deadline_result facts;
    assert_int_equal(pags_deadline_render_step(deadline, step, &s.part, 1, &s.camera, &s.options, &out, &facts),
                     PAGS_OK);
    assert_true(out.width == lround(WIDTH / divisor) && out.height == lround(HEIGHT / divisor));
    other.camera = (pags_camera){.width = out.width,
                                 .height = out.height,
                                 .fx = s.camera.fx * out.width / WIDTH,
                                 .fy = s.camera.fy * out.height / HEIGHT,
                                 .cx = out.width / 2.0,
                                 .cy = out.height / 2.0,
                                 .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    const pags_picture wanted = draw_step(&other, step);
    for (int y = 0; y < out.height; y++)
      assert_memory_equal(out.rgb[0] + (int64_t)y * out.stride, wanted.rgb[0] + (int64_t)y * wanted.stride,
                          (size_t)out.width * sizeof(float));
  }
  pags_deadline_destroy(deadline);
  destroy(&s);
  destroy(&other);
}

/* For passes only the picture's size is reduced, since they need whole frames. */
static void test_passes_are_whole(void **state) {
  (void)state;
  scene s, other;
  pags_deadline *deadline;
  uint8_t all_tiles[1024];
  memset(all_tiles, 1, sizeof all_tiles);
  create(&s);
  create(&other);
  s.options.keep_for_passes = 1;
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &deadline), PAGS_OK);
  const pags_picture whole = draw(&other, &other.options);
  for (int step = 1; step < PAGS_DEADLINE_WHOLE_STEPS; step++) {
    pags_picture out;
    pags_deadline_result facts;
    assert_int_equal(pags_deadline_render_step(deadline, step, &s.part, 1, &s.camera, &s.options, &out, &facts),
                     PAGS_OK);
    assert_int_equal(differing(&whole, &out, all_tiles), 0);
  }
  pags_deadline_destroy(deadline);
  destroy(&s);
  destroy(&other);
}

/* If the first frame is too slow, it is drawn again at the chosen step; later frames aren't. */
static void test_the_first_frame(void **state) {
  (void)state;
  scene s;
  pags_deadline *deadline;
  pags_picture out;
  pags_deadline_result facts;
  create(&s);
  assert_int_equal(pags_deadline_create(s.tasks, s.priority, COUNT, &deadline), PAGS_OK);
  pags_deadline_controller c = pags_deadline_controller_begin(1e-6), long_time = pags_deadline_controller_begin(1e6);
  assert_int_equal(pags_deadline_render(deadline, &c, &s.part, 1, &s.camera, &s.options, &out, &facts), PAGS_OK);
  assert_true(facts.step == PAGS_DEADLINE_WHOLE_STEPS - 1 && !facts.met && out.width == WIDTH);
  assert_int_equal(pags_deadline_render(deadline, &long_time, &s.part, 1, &s.camera, &s.options, &out, &facts),
                   PAGS_OK);
  assert_true(facts.step == 0 && facts.met && long_time.last_step == 0);
  pags_deadline_destroy(deadline);
  destroy(&s);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_nothing_is_given_up_for_nothing),
      cmocka_unit_test(test_the_time_is_kept),
      cmocka_unit_test(test_the_impossible),
      cmocka_unit_test(test_live),
      cmocka_unit_test(test_no_oscillation),
      cmocka_unit_test(test_a_scene_that_gets_slower),
      cmocka_unit_test(test_pace),
      cmocka_unit_test(test_rest_is_cut),
      cmocka_unit_test(test_steps),
      cmocka_unit_test(test_neighbours_are_full),
      cmocka_unit_test(test_samples_are_interpolated),
      cmocka_unit_test(test_smaller),
      cmocka_unit_test(test_passes_are_whole),
      cmocka_unit_test(test_the_first_frame),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
