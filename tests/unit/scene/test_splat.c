/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the readers of .splat files and of PlayCanvas' compressed PLY. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <pags/scene.h>
#include "base/bytes.h"
#include "scratch_folder.h"
#include "shared_data.h"
#include "splat_files.h"

#include <cmocka.h>

static double plane(const pags_gaussians *g, int p, int64_t i) {
  return (double)pags_plane(g, p)[i];
}

static double sigmoid(double x) {
  return 1 / (1 + exp(-x));
}

static void a_splat_row_decodes(void **state) {
  (void)state;
  file_bytes file = {0};
  const float head[6] = {1.5f, -2, 3, 0.5f, 0.25f, 0};
  const uint8_t tail[8] = {255, 0, 51, 204, 255, 128, 0, 64}, none[8] = {0, 0, 0, 255, 128, 128, 128, 128};
  for (int row = 0; row < 2; row++) {
    for (int i = 0; i < 6; i++)
      bytes_f32(&file, head[i]);
    bytes_put(&file, row ? none : tail, 8);
  }
  pags_gaussians g;
  const char *kind;
  int antialiased = 7;
  assert_int_equal(pags_splat_load(scratch_file("a.SPLAT", file.data, file.size), &g, &kind, &antialiased), PAGS_OK);
  assert_string_equal(kind, "splat");
  assert_int_equal(antialiased, 0);
  assert_int_equal(g.count, 2);
  assert_true(plane(&g, 0, 0) == 1.5 && plane(&g, 1, 0) == -2 && plane(&g, 2, 0) == 3);
  assert_true(fabs(plane(&g, PAGS_SCALE, 0) - log(0.5)) < 1e-6);
  assert_true(isfinite(plane(&g, PAGS_SCALE + 2, 0)) && plane(&g, PAGS_SCALE + 2, 0) < -20);
  assert_true(fabs(0.5 + 0.28209479 * plane(&g, PAGS_SH, 0) - 1) < 1e-6);
  assert_true(fabs(0.5 + 0.28209479 * plane(&g, PAGS_SH + 2, 0) - 0.2) < 1e-6);
  assert_true(fabs(sigmoid(plane(&g, PAGS_OPACITY, 0)) - 0.8) < 1e-6);
  assert_true(plane(&g, PAGS_ROTATION, 0) == 127 / 128.0 && plane(&g, PAGS_ROTATION + 2, 0) == -1);
  assert_true(plane(&g, PAGS_ROTATION, 1) == 1 && plane(&g, PAGS_ROTATION + 1, 1) == 0); /* the zero quaternion */
  assert_true(fabs(sigmoid(plane(&g, PAGS_OPACITY, 1)) - (1 - 1e-6)) < 1e-7);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

static void assert_fails(const char *name, const file_bytes *file, size_t size, const char *message) {
  pags_gaussians g;
  assert_int_equal(pags_splat_load(scratch_file(name, file->data, size), &g, NULL, NULL), PAGS_ERROR_FORMAT);
  if (!strstr(pags_error_message(), message) || !strstr(pags_error_message(), name))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
  assert_null(g.data);
}

static void bad_splats_are_explained(void **state) {
  (void)state;
  file_bytes file = make_splat(4, 1);
  assert_fails("a.splat", &file, 127, "expected a positive multiple of 32 bytes in a .splat file, found 127");
  assert_fails("a.splat", &file, 0, "found 0");
  assert_fails("a.bin", &file, 128, "expected a splat file");
  uint32_t nan = 0x7FC00000;
  pags_gaussians g;
  memcpy(file.data + 64 + 8, &nan, 4);
  file.data[32 + 15] |= 0x80; /* sets the sign bit of the second Gaussian's first sigma */
  assert_int_equal(pags_splat_load(scratch_file("a.splat", file.data, 128), &g, NULL, NULL), PAGS_OK);
  assert_int_equal(g.count, 2);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  file = make_splat(1, 1);
  file.data[15] |= 0x80;
  assert_fails("a.splat", &file, 32, "Gaussian 0: expected finite numbers for its scale");
  bytes_free(&file);
}

/* A compressed PLY whose chunk bounds and single vertex are chosen so that every decoded field has a known value. */
static void a_packed_vertex_decodes(void **state) {
  (void)state;
  file_bytes file = make_compressed_ply(1, 1, 1, 1);
  uint8_t *chunk = file.data + file.size - 9 - 16 - 72, *vertex = chunk + 72, *sh = vertex + 16;
  for (int i = 0; i < 18; i++) /* the lower bound of value i is -i, the upper bound i */
    pags_store_f32(chunk + 4 * i, (float)(i / 3 % 2 ? i : -i));
  pags_store_u32(vertex, 2047u << 21 | 0u << 11 | 2047u);
  /* Y is the largest component; w, x, z are stored. */
  pags_store_u32(vertex + 4, 2u << 30 | 1023u << 20 | 0u << 10 | 512u);
  pags_store_u32(vertex + 8, 0u << 21 | 1023u << 11 | 0u);
  pags_store_u32(vertex + 12, 255u << 24 | 0u << 16 | 51u << 8 | 204u);
  for (int i = 0; i < 9; i++)
    sh[i] = (uint8_t)(10 * i);
  pags_gaussians g;
  const char *kind;
  assert_int_equal(pags_splat_load(scratch_file("c.ply", file.data, file.size), &g, &kind, NULL), PAGS_OK);
  assert_string_equal(kind, "compressed PLY");
  const double expected[6] = {3, -1, 5, -6, 10, -8};
  for (int p = 0; p < 6; p++)
    assert_true(plane(&g, p, 0) == expected[p]);
  const double half = sqrt(0.5), z = (512 / 1023.0 - 0.5) * sqrt(2);
  assert_true(fabs(plane(&g, PAGS_ROTATION, 0) - half) < 1e-6);
  assert_true(fabs(plane(&g, PAGS_ROTATION + 1, 0) + half) < 1e-6);
  assert_true(fabs(plane(&g, PAGS_ROTATION + 3, 0) - z) < 1e-7);
  assert_true(fabs(plane(&g, PAGS_ROTATION + 2, 0) - sqrt(fmax(0, 1 - 2 * half * half - z * z))) < 1e-3);
  const double colours[3] = {15, -13, -14 + 0.2 * 31};
  for (int k = 0; k < 3; k++)
    assert_true(fabs(0.5 + 0.28209479177 * plane(&g, PAGS_SH + k, 0) - colours[k]) < 1e-5);
  assert_true(fabs(sigmoid(plane(&g, PAGS_OPACITY, 0)) - 0.8) < 1e-6);
  for (int channel = 0; channel < 3; channel++) /* channel-major in the file, coefficient-major in memory */
    for (int k = 0; k < 3; k++)
      assert_true(fabs(plane(&g, PAGS_SH + 3 + 3 * k + channel, 0) - (10 * (3 * channel + k) * 8 / 255.0 - 4)) < 1e-6);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

static void older_files_have_no_colour_bounds(void **state) {
  (void)state;
  file_bytes file = make_compressed_ply(300, 0, 0, 2);
  pags_gaussians g;
  assert_int_equal(pags_splat_load(scratch_file("c.ply", file.data, file.size), &g, NULL, NULL), PAGS_OK);
  uint32_t colour = pags_load_u32(file.data + file.size - 4);
  assert_true(fabs(0.5 + 0.28209479177 * plane(&g, PAGS_SH, 299) - (colour >> 24) / 255.0) < 1e-6);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

/* Positions between bounds far from zero keep all their digits relative to an origin. */
static void a_packed_vertex_far_away_keeps_its_digits(void **state) {
  (void)state;
  file_bytes file = make_compressed_ply(1, 0, 1, 2);
  uint8_t *chunk = file.data + file.size - 16 - 72, *vertex = chunk + 72;
  for (int k = 0; k < 3; k++) {
    pags_store_f32(chunk + 4 * k, 4600000.0f);
    pags_store_f32(chunk + 12 + 4 * k, 4600001.0f);
  }
  pags_store_u32(vertex, 1024u << 21 | 256u << 11 | 512u);
  pags_gaussians g;
  pags_splat_facts facts;
  assert_int_equal(pags_splat_read(scratch_file("c.ply", file.data, file.size), 0, &g, &facts), PAGS_OK);
  const double expected[3] = {1024 / 2047.0, 256 / 1023.0, 512 / 2047.0};
  for (int k = 0; k < 3; k++)
    assert_true(facts.origin[k] == 4600000 && fabs(plane(&g, k, 0) - expected[k]) < 1e-6);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

static void bad_compressed_files_are_explained(void **state) {
  (void)state;
  file_bytes file = make_compressed_ply(300, 1, 1, 3);
  assert_fails("c.ply", &file, file.size - 1, "truncated: expected 300 rows of 'sh' (9 bytes each)");
  char *text = strstr((char *)file.data, "chunk 2");
  text[6] = '1';
  assert_fails("c.ply", &file, file.size, "expected 2 chunks for 300 vertices, found 1");
  text[6] = '2';
  text = strstr((char *)file.data, "element sh 300");
  text[11] = '2';
  assert_fails("c.ply", &file, file.size, "rows in element 'sh', found 9 and 200");
  text[11] = '3';
  text = strstr((char *)file.data, "packed_scale");
  text[0] = 'q';
  assert_fails("c.ply", &file, file.size, "no property 'packed_scale'");
  text[0] = 'p';
  uint8_t *chunk = file.data + file.size - 300 * 25 - 2 * 72;
  pags_gaussians g;
  pags_store_u32(chunk + 72 + 4, 0x7FC00000);
  assert_int_equal(pags_splat_load(scratch_file("c.ply", file.data, file.size), &g, NULL, NULL), PAGS_OK);
  assert_int_equal(g.count, 256);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

static void luma_seal_reads(void **state) {
  (void)state;
  char path[1024];
  if (!pags_shared_data("splats/luma-seal.splat", path, sizeof path))
    skip();
  pags_gaussians g;
  assert_int_equal(pags_splat_load(path, &g, NULL, NULL), PAGS_OK);
  assert_int_equal(g.count, 101780);
  for (int64_t i = 0; i < g.count; i++)
    for (int k = 0; k < 3; k++)
      assert_true(fabs(plane(&g, k, i)) < 3 && plane(&g, PAGS_SCALE + k, i) < 1);
  pags_gaussians_destroy(&g);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(a_splat_row_decodes),
      cmocka_unit_test(bad_splats_are_explained),
      cmocka_unit_test(a_packed_vertex_decodes),
      cmocka_unit_test(older_files_have_no_colour_bounds),
      cmocka_unit_test(a_packed_vertex_far_away_keeps_its_digits),
      cmocka_unit_test(bad_compressed_files_are_explained),
      cmocka_unit_test(luma_seal_reads),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
