/* SPDX-License-Identifier: Apache-2.0 */
/* Tests packed Gaussians: the stated error of each attribute, equal pictures from packed and unpacked rows, files
 * and damaged files. */
#include <math.h>
#include <pags/compose.h>
#include <pags/packed.h>
#include <pags/scene.h>
#include <stdbool.h>

#include "base/rng.h"
#include "unit/scratch.h"

static scratch place;

static float normal(uint64_t what, int64_t row) {
  double pair[2];
  pags_rng_normal2(17, what, (uint64_t)row, pair);
  return (float)pair[0];
}

/* Half of the Gaussians lie in front of a camera at the origin that looks along z, half behind it. */
static pags_gaussians make_cloud(int64_t count, int degree) {
  pags_gaussians g;
  scratch_ok(pags_gaussians_create(&g, count, degree));
  scratch_ok(pags_gaussians_add_s_sem(&g));
  for (int64_t i = 0; i < count; i++) {
    for (int k = 0; k < 3; k++) {
      pags_plane(&g, PAGS_MEAN + k)[i] = (k == 2 ? i / 8 % 2 ? -40.0f : 8.0f : 0.0f) +
                                         2.0f * normal((uint64_t)k, i / 8) + 0.1f * normal(60u + (uint64_t)k, i);
      pags_plane(&g, PAGS_SCALE + k)[i] = -2.5f + normal(3u + (uint64_t)k, i);
    }
    for (int k = 0; k < 4; k++)
      pags_plane(&g, PAGS_ROTATION + k)[i] = 3.0f * normal(6u + (uint64_t)k, i);
    pags_plane(&g, PAGS_OPACITY)[i] = 2.0f * normal(10, i);
    for (int p = PAGS_SH; p < pags_plane_count(degree); p++)
      pags_plane(&g, p)[i] = (p < PAGS_SH + 3 ? 1.0f : 0.1f) * normal((uint64_t)p, i);
    g.s_sem[i] = fminf(fabsf(normal(59, i)), 1.0f);
  }
  return g;
}

static float largest_in_cluster(const float *plane, int64_t row, int64_t count) {
  float most = 0.0f;
  for (int64_t i = row / 64 * 64; i < count && i < row / 64 * 64 + 64; i++)
    most = fmaxf(most, fabsf(plane[i]));
  return most;
}

static void check_mean(const pags_gaussians *g, const pags_gaussians *back, const pags_packed *packed, int64_t i) {
  for (int k = 0; k < 3; k++) {
    const float side = packed->clusters.hi[k][i / 64] - packed->clusters.lo[k][i / 64];
    const float error = fabsf(pags_plane(g, k)[i] - pags_plane(back, k)[i]);
    assert_true(error <= side / 131070.0f * 1.001f + 2e-6f);
    assert_true(pags_plane(back, k)[i] >= packed->clusters.lo[k][i / 64] &&
                pags_plane(back, k)[i] <= packed->clusters.hi[k][i / 64]);
  }
}

/* The angle 2 acos |q . p| between the rotations, computed from |q - p|, which is accurate in float for small
 * angles. */
static void check_rotation(const pags_gaussians *g, const pags_gaussians *back, int64_t i) {
  double q[4], p[4], norm = 0, dot = 0, apart = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[i];
    p[k] = (double)pags_plane(back, PAGS_ROTATION + k)[i];
    norm += q[k] * q[k];
    dot += q[k] * p[k];
  }
  for (int k = 0; k < 4; k++) {
    const double difference = q[k] / sqrt(norm) * (dot < 0 ? -1 : 1) - p[k];
    apart += difference * difference;
  }
  assert_true(2 * sqrt(apart) <= 1.2e-4);
}

static void test_errors(void **state) {
  (void)state;
  for (int degree = 0; degree <= 3; degree++) {
    pags_gaussians g = make_cloud(1000, degree), back;
    pags_packed packed;
    scratch_ok(pags_packed_create(&g, &packed));
    scratch_ok(pags_packed_unpack(&packed, &back));
    assert_int_equal(back.count, g.count);
    assert_int_equal(back.sh_degree, degree);
    for (int64_t i = 0; i < g.count; i++) {
      check_mean(&g, &back, &packed, i);
      check_rotation(&g, &back, i);
      for (int k = 0; k < 3; k++) {
        assert_true(fabsf(pags_plane(&g, PAGS_SCALE + k)[i] - pags_plane(&back, PAGS_SCALE + k)[i]) <= 2.5e-4f);
        assert_true(expf(pags_plane(&back, PAGS_SCALE + k)[i]) <= packed.clusters.sigma[i / 64]);
        const float dc = pags_plane(&g, PAGS_SH + k)[i];
        assert_true(fabsf(dc - pags_plane(&back, PAGS_SH + k)[i]) <= fabsf(dc) * 0x1p-11f + 0x1p-24f);
      }
      assert_true(fabsf(pags_plane(&g, PAGS_OPACITY)[i] - pags_plane(&back, PAGS_OPACITY)[i]) <= 2.5e-4f);
      for (int p = PAGS_SH + 3; p < pags_plane_count(degree); p++)
        assert_true(fabsf(pags_plane(&g, p)[i] - pags_plane(&back, p)[i]) <=
                    largest_in_cluster(pags_plane(&g, p), i, g.count) / 254.0f * 1.001f);
      assert_true(fabsf(g.s_sem[i] - back.s_sem[i]) <= 1.0f / 510.0f + 1e-6f);
    }
    pags_packed_destroy(&packed);
    pags_gaussians_destroy(&back);
    pags_gaussians_destroy(&g);
  }
}

/* Values beyond an attribute's range are clamped to its end, a zero quaternion becomes the identity, and a single row
 * can be packed. */
static void test_ends(void **state) {
  (void)state;
  pags_gaussians g, back;
  pags_packed packed;
  scratch_ok(pags_gaussians_create(&g, 1, 1));
  pags_plane(&g, PAGS_MEAN)[0] = 1e9f;
  pags_plane(&g, PAGS_SCALE)[0] = -200.0f;
  pags_plane(&g, PAGS_SCALE + 1)[0] = 40.0f;
  pags_plane(&g, PAGS_OPACITY)[0] = 30.0f;
  pags_plane(&g, PAGS_SH)[0] = 1e9f;
  scratch_ok(pags_packed_create(&g, &packed));
  scratch_ok(pags_packed_unpack(&packed, &back));
  assert_true(pags_plane(&back, PAGS_MEAN)[0] == 1e9f);
  assert_true(pags_plane(&back, PAGS_SCALE)[0] == -16.0f &&
              fabsf(pags_plane(&back, PAGS_SCALE + 1)[0] - 16.0f) < 1e-5f);
  assert_true(fabsf(pags_plane(&back, PAGS_OPACITY)[0] - 16.0f) < 1e-5f);
  assert_true(pags_plane(&back, PAGS_SH)[0] == 65504.0f);
  assert_true(pags_plane(&back, PAGS_ROTATION)[0] > 0.9999f);
  assert_null(back.s_sem);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&back);
  pags_gaussians_destroy(&g);
}

static void test_bytes(void **state) {
  (void)state;
  pags_gaussians g = make_cloud(64000, 1);
  pags_packed packed;
  scratch_ok(pags_packed_create(&g, &packed));
  const double each = (double)pags_packed_bytes(&packed) / 64000;
  /* 21 + 6 + 9 bytes for a row, 0.44 for bounds, 0.56 for quantisation steps, and padding to 64 bytes. */
  assert_true(each > 37 && each < 39);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&g);
}

/* A composition of a scene with one model; takes ownership of `g`. */
static pags_composition *compose(pags_gaussians *g) {
  pags_scene scene = {.model_count = 1, .up = PAGS_UP_Z};
  pags_composition *out;
  scene.models = calloc(1, sizeof *scene.models);
  assert_non_null(scene.models);
  scene.models[0].gaussians = *g;
  scratch_ok(pags_composition_create(&scene, &out));
  return out;
}

/* 125 clusters in front and 125 behind, so that a run of 64 clusters is culled as a whole. */
enum { WIDTH = 96, HEIGHT = 64, CLOUD = 16000 };
typedef struct drawn {
  float rgb[3][WIDTH * HEIGHT];
  int32_t id[WIDTH * HEIGHT];
} drawn;

/* Returns how many Gaussians are in clusters in view. */
static int64_t draw_by(pags_composition *composition, pags_early_z mode, drawn *out) {
  const pags_camera camera = {.width = WIDTH,
                              .height = HEIGHT,
                              .fx = 90,
                              .fy = 90,
                              .cx = 48,
                              .cy = 32,
                              .world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
  pags_frame_options options = pags_composition_options(composition);
  pags_tasks *tasks = pags_tasks_create(2);
  pags_frame *frame;
  const pags_part *parts;
  int count;
  pags_picture picture;
  options.extra_channels = 1;
  options.early_z = mode;
  scratch_ok(pags_frame_create(tasks, &frame));
  pags_compose(composition, 0, &parts, &count);
  scratch_ok(pags_frame_render(frame, parts, count, &camera, &options, NULL, NULL, &picture));
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      for (int k = 0; k < 3; k++)
        out->rgb[k][y * WIDTH + x] = picture.rgb[k][y * picture.stride + x];
      out->id[y * WIDTH + x] = picture.id[y * picture.stride + x];
    }
  const int64_t in_view = pags_frame_stats_get(frame)->in_view;
  pags_frame_destroy(frame);
  pags_tasks_destroy(tasks);
  return in_view;
}

static void draw(pags_composition *composition, drawn *out) {
  draw_by(composition, PAGS_EARLY_Z_OFF, out);
}

/* Drawing packed rows gives the bits of drawing the unpacked rows, and is close to the picture of the originals. */
static void test_picture(void **state) {
  (void)state;
  static drawn original, packed, unpacked;
  for (int degree = 0; degree <= 3; degree++) {
    pags_gaussians g = make_cloud(CLOUD, degree), same = make_cloud(CLOUD, degree);
    pags_composition *composition = compose(&g);
    draw(composition, &original);
    const size_t before = pags_composition_bytes(composition);
    scratch_ok(pags_composition_pack(composition));
    assert_true(pags_composition_bytes(composition) < before);
    draw_by(composition, PAGS_EARLY_Z_LOSSLESS, &unpacked);
    draw(composition, &packed);
    assert_memory_equal(&packed, &unpacked, sizeof packed);
    float *priority = malloc(CLOUD * sizeof *priority);
    assert_true(pags_composition_priorities(composition, priority));
    assert_true(fabsf(priority[1234] - same.s_sem[1234]) <= 1.0f / 510.0f + 1e-6f);
    free(priority);
    pags_composition_destroy(composition);
    /* The RMS error rather than the largest: means whose depth order changes by rounding are blended in another
     * order. */
    double squares = 0, lit = 0;
    for (int k = 0; k < 3; k++)
      for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const double error = (double)original.rgb[k][i] - (double)packed.rgb[k][i];
        squares += error * error;
        lit += (double)packed.rgb[k][i];
      }
    const double rms = sqrt(squares / (3.0 * WIDTH * HEIGHT));
    print_message("degree %d: RMS error %.2g\n", degree, rms);
    assert_true(lit > 500 && rms > 0 && rms < 1.0 / 255);
    int64_t *order = malloc(CLOUD * sizeof *order);
    pags_gaussians sorted, back;
    pags_packed rows;
    scratch_ok(pags_gaussians_create_like(&sorted, CLOUD, &same));
    scratch_ok(pags_gaussians_morton_order(&same, order));
    pags_gaussians_gather(&same, order, CLOUD, &sorted);
    scratch_ok(pags_packed_create(&sorted, &rows));
    scratch_ok(pags_packed_unpack(&rows, &back));
    composition = compose(&back);
    draw(composition, &unpacked);
    assert_memory_equal(packed.rgb, unpacked.rgb, sizeof packed.rgb);
    pags_composition_destroy(composition);
    pags_packed_destroy(&rows);
    pags_gaussians_destroy(&sorted);
    pags_gaussians_destroy(&same);
    free(order);
  }
}

static void test_file(void **state) {
  (void)state;
  static drawn memory, file;
  pags_gaussians g = make_cloud(700, 1), back;
  pags_packed packed, opened;
  char *path = pags_path_join(place.folder, "a.pagsz");
  g.alpha_min = 0.03f;
  scratch_ok(pags_packed_create(&g, &packed));
  packed.up = PAGS_UP_Z;
  packed.origin[1] = 5;
  scratch_ok(pags_packed_save(path, &packed, 1, NULL));
  assert_true(pags_packed_is_file(path));
  scratch_ok(pags_packed_open(path, &opened));
  assert_int_equal(opened.shape.count, 700);
  assert_true(opened.shape.alpha_min == 0.03f);
  assert_true(opened.origin[1] == 5 && opened.up == PAGS_UP_Z && opened.has_s_sem == 1);
  assert_int_equal(pags_packed_bytes(&opened), pags_packed_bytes(&packed));
  assert_memory_equal((uint8_t *)opened.block + 128, (uint8_t *)packed.block + 128, packed.block_size - 128);
  pags_packed_destroy(&opened);
  pags_composition *composition;
  scratch_ok(pags_composition_load(path, &composition));
  assert_int_equal(pags_composition_gaussian_count(composition), 700);
  assert_true(pags_composition_scene(composition)->origin[1] == 5);
  draw(composition, &file);
  pags_composition_destroy(composition);
  scratch_ok(pags_packed_unpack(&packed, &back));
  pags_scene scene;
  scratch_ok(pags_scene_load(path, &scene)); /* the scene loader unpacks the rows to planes */
  assert_int_equal(scene.models[0].gaussians.count, 700);
  assert_true(scene.models[0].gaussians.alpha_min == 0.03f);
  assert_memory_equal(pags_plane(&scene.models[0].gaussians, 4), pags_plane(&back, 4), 700 * sizeof(float));
  scratch_ok(pags_composition_create(&scene, &composition));
  draw(composition, &memory);
  assert_memory_equal(memory.rgb, file.rgb, sizeof file.rgb);
  pags_composition_destroy(composition);
  pags_gaussians_destroy(&back);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&g);
  free(path);
}

static void test_copies(void **state) {
  (void)state;
  const double offsets[6] = {0, 0, 0, 100, 0, -7};
  pags_gaussians g = make_cloud(200, 1), once, twice;
  pags_packed packed, opened;
  const char *path = scratch_path(&place, "b.pagsz");
  scratch_ok(pags_packed_create(&g, &packed));
  scratch_ok(pags_packed_save(path, &packed, 2, offsets));
  scratch_ok(pags_packed_open(path, &opened));
  assert_int_equal(opened.shape.count, 2 * 192);
  scratch_ok(pags_packed_unpack(&packed, &once));
  scratch_ok(pags_packed_unpack(&opened, &twice));
  for (int64_t i = 0; i < 192; i++) {
    assert_true(pags_plane(&twice, 0)[i] == pags_plane(&once, 0)[i]);
    assert_true(fabsf(pags_plane(&twice, 0)[192 + i] - pags_plane(&once, 0)[i] - 100.0f) < 1e-4f);
    assert_true(fabsf(pags_plane(&twice, 2)[192 + i] - pags_plane(&once, 2)[i] + 7.0f) < 1e-4f);
    assert_true(pags_plane(&twice, 13)[192 + i] == pags_plane(&once, 13)[i]);
  }
  pags_gaussians_destroy(&once);
  pags_gaussians_destroy(&twice);
  pags_packed_destroy(&opened);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&g);
}

/* Rows far from the others of their cluster, or with far larger harmonics, are stored whole and don't reduce the
 * accuracy of the others. Tested with one, a few, half of a cluster, all rows, and some rows of an unfinished
 * cluster. */
static void test_stray_rows(void **state) {
  (void)state;
  static const float far[] = {1e3f, 1e6f, -1e12f, 1e30f, -3e38f, 3e38f};
  for (int degree = 0; degree <= 3; degree += 3) {
    pags_gaussians g = make_cloud(400, degree), back, copies;
    pags_packed packed, opened;
    bool stray[400] = {false};
    for (int i = 0; i < 400; i++) {
      const int cluster = i / 64, row = i % 64;
      stray[i] = (cluster == 0 && row == 7) || (cluster == 1 && row % 11 == 0) || (cluster == 2 && row % 2) ||
                 cluster == 3 || (cluster == 6 && row < 2);
      for (int k = 0; k < 3; k++) /* all others are near each other */
        pags_plane(&g, PAGS_MEAN + k)[i] = 5.0f + 0.2f * normal(70u + (uint64_t)k, i);
      if (cluster == 2 && row % 2)
        pags_plane(&g, PAGS_MEAN + 1)[i] += 1e5f;
      else if (stray[i])
        pags_plane(&g, PAGS_MEAN + i % 3)[i] = far[i / 3 % 6] * (1.0f + 0.001f * (float)row);
      if (degree && cluster == 4 && row % 13 == 0) {
        pags_plane(&g, PAGS_SH + 3 + row % 45)[i] = row == 13 ? 1e6f : 40.0f;
        stray[i] = true;
      }
    }
    for (int k = 0; k < 4; k++) /* a zero quaternion becomes the identity here as well */
      pags_plane(&g, PAGS_ROTATION + k)[7] = 0.0f;
    scratch_ok(pags_packed_create(&g, &packed));
    scratch_path(&place, "stray.pagsz");
    scratch_ok(pags_packed_save(place.path, &packed, 1, NULL));
    scratch_ok(pags_packed_open(place.path, &opened));
    scratch_ok(pags_packed_unpack(&opened, &back));
    for (int i = 0; i < 400; i++) {
      for (int k = 0; k < 3; k++) {
        const float mean = pags_plane(&g, k)[i];
        const float error = fabsf(mean - pags_plane(&back, k)[i]);
        assert_true(error <= (i / 64 == 2 || !stray[i] ? 2e-5f : 0.0f) ||
                    (i / 64 == 2 && error <= fabsf(mean) * 1e-7f));
        assert_true(pags_plane(&back, k)[i] >= opened.clusters.lo[k][i / 64] &&
                    pags_plane(&back, k)[i] <= opened.clusters.hi[k][i / 64]);
      }
      for (int p = PAGS_SH + 3; p < pags_plane_count(degree); p++)
        assert_true(fabsf(pags_plane(&g, p)[i] - pags_plane(&back, p)[i]) <= 2.0f / 254.0f);
    }
    assert_true(pags_plane(&back, PAGS_ROTATION)[7] == 1.0f && pags_gaussians_find_bad(&back, NULL) == 0);
    const double offsets[6] = {0, 0, 0, 100, 0, -7};
    scratch_ok(pags_packed_save(place.path, &packed, 2, offsets));
    pags_packed_destroy(&opened);
    scratch_ok(pags_packed_open(place.path, &opened));
    scratch_ok(pags_packed_unpack(&opened, &copies));
    assert_int_equal(copies.count, 2 * 384);
    for (int i = 0; i < 384; i++)
      assert_true(fabs((double)pags_plane(&copies, 0)[384 + i] - (double)pags_plane(&back, 0)[i] - 100) <=
                  1e-5 + fabs((double)pags_plane(&back, 0)[i]) * 1e-7);
    pags_packed_destroy(&opened);
    pags_packed_destroy(&packed);
    pags_gaussians_destroy(&copies);
    pags_gaussians_destroy(&back);
    pags_gaussians_destroy(&g);
  }
}

/* Stray Gaussians don't enlarge the clusters of the others, so those out of view are culled as before, and the
 * packed picture stays the same. */
static void test_stray_rows_and_culling(void **state) {
  (void)state;
  static drawn plain, packed, without;
  static const float far[] = {1e9f, 1e30f};
  pags_gaussians cloud = make_cloud(CLOUD, 0);
  pags_composition *composition = compose(&cloud);
  const int64_t seen = draw_by(composition, PAGS_EARLY_Z_OFF, &without);
  pags_composition_destroy(composition);
  assert_true(seen < CLOUD * 6 / 10);
  for (int n = 0; n < 2; n++) {
    pags_gaussians g = make_cloud(CLOUD, 0);
    for (int i = 0; i < 1 + 99 * n; i++)
      pags_plane(&g, PAGS_MEAN + i % 3)[160 * i + 1] = far[n] * (i % 2 ? -1.0f : 1.0f);
    composition = compose(&g);
    assert_true(draw_by(composition, PAGS_EARLY_Z_OFF, &plain) < seen + CLOUD / 20);
    scratch_ok(pags_composition_pack(composition));
    assert_true(draw_by(composition, PAGS_EARLY_Z_OFF, &packed) < seen + CLOUD / 20);
    pags_composition_destroy(composition);
    double squares = 0;
    for (int k = 0; k < 3; k++)
      for (int i = 0; i < WIDTH * HEIGHT; i++)
        squares += pow((double)plain.rgb[k][i] - (double)packed.rgb[k][i], 2);
    assert_true(sqrt(squares / (3.0 * WIDTH * HEIGHT)) < 1.0 / 255);
  }
}

/* Every written file can be read, also with colours below 0 or above 1. Values that readers refuse are not written. */
static void test_written_is_readable(void **state) {
  (void)state;
  pags_gaussians g = make_cloud(100, 0);
  pags_packed head = {.background = {-1.5f, 0, 7}}, opened;
  scratch_path(&place, "w.pagsz");
  scratch_ok(pags_packed_export(place.path, &g, &head));
  scratch_ok(pags_packed_open(place.path, &opened));
  assert_memory_equal(opened.background, head.background, sizeof head.background);
  pags_packed_destroy(&opened);
  head.origin[1] = (double)NAN;
  scratch_expect(pags_packed_export(place.path, &g, &head), PAGS_ERROR_ARGUMENT, "finite origin");
  head.origin[1] = 0;
  pags_plane(&g, PAGS_SCALE + 1)[42] = INFINITY;
  scratch_expect(pags_packed_export(place.path, &g, &head), PAGS_ERROR_ARGUMENT, "Gaussian 42");
  pags_gaussians_destroy(&g);
}

/* Writes the bytes to a file and expects a refusal whose message contains `part`. */
static void refuses(const uint8_t *bytes, size_t size, const char *part) {
  pags_packed opened;
  scratch_write(&place, "bad.pagsz", bytes, size);
  scratch_expect(pags_packed_open(place.path, &opened), PAGS_ERROR_FORMAT, part);
  assert_null(opened.block);
}

/* Colours aren't checked when a file is opened: any bits decode to finite values. */
static void test_bad_colours(void **state) {
  (void)state;
  pags_gaussians g = make_cloud(100, 1), back;
  pags_packed packed, opened;
  const float bad[3] = {(float)NAN, INFINITY, -3e38f};
  scratch_ok(pags_packed_create(&g, &packed));
  uint8_t *const colour = (uint8_t *)(uintptr_t)packed.colour;
  memset(colour, 0x7F, 2 * 64); /* half-precision values that are NaN */
  memcpy(colour + 64 * (6 + 9), bad, sizeof bad);
  scratch_path(&place, "colours.pagsz");
  scratch_ok(pags_packed_save(place.path, &packed, 1, NULL));
  scratch_ok(pags_packed_open(place.path, &opened));
  scratch_ok(pags_packed_unpack(&opened, &back));
  assert_int_equal(pags_gaussians_find_bad(&back, NULL), 0);
  pags_gaussians_destroy(&back);
  pags_packed_destroy(&opened);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&g);
}

static void test_faults(void **state) {
  (void)state;
  pags_gaussians g = make_cloud(100, 1);
  pags_packed packed;
  uint8_t *bytes;
  size_t size;
  char *path = pags_path_join(place.folder, "c.pagsz");
  scratch_ok(pags_packed_create(&g, &packed));
  scratch_ok(pags_packed_save(path, &packed, 1, NULL));
  scratch_ok(pags_file_read(path, &bytes, &size));
  refuses(bytes, 100, "a head of 128 bytes");
  refuses(bytes, size - 1, "expected");
  bytes[8] ^= 64;
  refuses(bytes, size, "bytes for");
  bytes[8] ^= 64;
  bytes[15] = 0x7F;
  refuses(bytes, size, "at most 2^31");
  bytes[15] = 0;
  bytes[16] = 9;
  refuses(bytes, size, "degree 0 to 3");
  bytes[16] = 1;
  memcpy(bytes + 128, &(float){(float)NAN}, 4);
  refuses(bytes, size, "cluster 0");
  bytes[0] = 'X';
  refuses(bytes, size, "PAGSPK01");
  free(bytes);
  free(path);
  pags_packed_destroy(&packed);
  pags_gaussians_destroy(&g);
}

/* Damaged lists of whole rows. */
static void test_faults_of_whole_rows(void **state) {
  (void)state;
  pags_gaussians g = make_cloud(200, 1);
  pags_packed head = {0}, opened;
  uint8_t *bytes;
  size_t size;
  for (int i = 0; i < 200; i += 50)
    pags_plane(&g, PAGS_MEAN)[i] = 1e20f;
  char *path = pags_path_join(place.folder, "d.pagsz");
  scratch_ok(pags_packed_export(path, &g, &head));
  scratch_ok(pags_packed_open(path, &opened));
  const size_t mixed = (size_t)((const uint8_t *)opened.mixed - (uint8_t *)opened.block),
               whole = (size_t)(opened.whole - (uint8_t *)opened.block);
  assert_true(opened.mixed_count > 0 && opened.whole_count == 4);
  pags_packed_destroy(&opened);
  scratch_ok(pags_file_read(path, &bytes, &size));
  const struct {
    size_t at;
    uint32_t value;
    const char *part;
  } faults[] = {{64, 5, "clusters with whole rows"},
                {72, 201, "clusters with whole rows"},
                {72, 3, "bytes for"},
                {mixed, 4, "whole rows within"},
                {mixed + 4, 1, "whole rows within"},
                {mixed + 8, 0x7FC00000, "whole rows within"},
                {whole, 64, "whole rows within"},
                {whole + 4, 0x7F800000, "whole rows within"},
                {whole + 4 * 10, 0x7FC00000, "whole rows within"}};
  for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
    uint32_t before;
    memcpy(&before, bytes + faults[i].at, sizeof before);
    memcpy(bytes + faults[i].at, &faults[i].value, sizeof before);
    refuses(bytes, size, faults[i].part);
    memcpy(bytes + faults[i].at, &before, sizeof before);
  }
  free(bytes);
  free(path);
  pags_gaussians_destroy(&g);
}

static int setup(void **state) {
  (void)state;
  scratch_begin(&place);
  return 0;
}

static int teardown(void **state) {
  (void)state;
  scratch_end(&place);
  return 0;
}

int main(void) {
  const struct CMUnitTest tests[] = {cmocka_unit_test(test_errors),
                                     cmocka_unit_test(test_ends),
                                     cmocka_unit_test(test_bytes),
                                     cmocka_unit_test(test_picture),
                                     cmocka_unit_test(test_file),
                                     cmocka_unit_test(test_copies),
                                     cmocka_unit_test(test_faults),
                                     cmocka_unit_test(test_bad_colours),
                                     cmocka_unit_test(test_stray_rows),
                                     cmocka_unit_test(test_stray_rows_and_culling),
                                     cmocka_unit_test(test_written_is_readable),
                                     cmocka_unit_test(test_faults_of_whole_rows)};
  return cmocka_run_group_tests(tests, setup, teardown);
}
