/* SPDX-License-Identifier: Apache-2.0 */
/* Tests reading and writing of PLY files in the layout of INRIA's implementation of 3DGS. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <string.h>

#include <pags/scene.h>
#include "base/log.h"
#include "scratch_folder.h"
#include "shared_data.h"
#include "splat_files.h"

#include <cmocka.h>

static void assert_same(const pags_gaussians *a, const pags_gaussians *b) {
  assert_int_equal(a->count, b->count);
  assert_int_equal(a->sh_degree, b->sh_degree);
  for (int p = 0; p < pags_plane_count(a->sh_degree); p++)
    assert_memory_equal(pags_plane(a, p), pags_plane(b, p), (size_t)a->count * sizeof(float));
}

static void load(const char *path, pags_gaussians *g) {
  if (pags_ply_load(path, g) != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

static void assert_file_holds(const char *path, const uint8_t *bytes, size_t size) {
  uint8_t *found;
  size_t found_size;
  assert_int_equal(pags_file_read(path, &found, &found_size), PAGS_OK);
  assert_int_equal(found_size, size);
  assert_memory_equal(found, bytes, size);
  free(found);
}

static void every_degree_round_trips_to_the_byte(void **state) {
  (void)state;
  for (int degree = 0; degree <= 3; degree++) {
    pags_gaussians g, back;
    sample_gaussians(&g, 300, degree, 1);
    pags_plane(&g, PAGS_MEAN)[5] = -0.0f;
    file_bytes file = make_ply(&g);
    load(scratch_file("a.ply", file.data, file.size), &back);
    assert_same(&g, &back);
    assert_null(back.s_sem);
    assert_int_equal(pags_ply_save(scratch("b.ply"), &back), PAGS_OK);
    assert_file_holds(scratch("b.ply"), file.data, file.size);
    bytes_free(&file);
    pags_gaussians_destroy(&g);
    pags_gaussians_destroy(&back);
  }
}

static void any_order_and_encoding_reads_the_same(void **state) {
  (void)state;
  static const char *const formats[] = {"ascii 1.0", "binary_little_endian 1.0", "binary_big_endian 1.0"};
  for (int i = 0; i < 3; i++) {
    pags_gaussians g, back;
    sample_gaussians(&g, 290, 2, 2);
    file_bytes file = make_scrambled_ply(&g, formats[i]);
    load(scratch_file("a.ply", file.data, file.size), &back);
    assert_same(&g, &back);
    bytes_free(&file);
    pags_gaussians_destroy(&g);
    pags_gaussians_destroy(&back);
  }
}

static void extras_follow_the_standard_properties(void **state) {
  (void)state;
  pags_gaussians g, back;
  sample_gaussians(&g, 20, 1, 3);
  assert_int_equal(pags_gaussians_add_s_sem(&g), PAGS_OK);
  assert_int_equal(pags_gaussians_add_object_id(&g), PAGS_OK);
  g.s_sem[3] = 0.75f;
  g.object_id[4] = 16777217; /* 2^24 + 1, which float can't represent */
  assert_int_equal(pags_ply_save(scratch("e.ply"), &g), PAGS_OK);
  load(scratch("e.ply"), &back);
  assert_same(&g, &back);
  assert_memory_equal(g.s_sem, back.s_sem, 20 * sizeof(float));
  assert_memory_equal(g.object_id, back.object_id, 20 * sizeof(int32_t));
  pags_gaussians_destroy(&back);
  g.s_sem[19] = 1.5f;
  assert_int_equal(pags_ply_save(scratch("e.ply"), &g), PAGS_OK);
  assert_int_equal(pags_ply_load(scratch("e.ply"), &back), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "e.ply: vertex 19: expected 's_sem' from 0 to 1, found 1.5"));
  pags_gaussians_destroy(&g);
}

static void sample_fourier(pags_gaussians *g, int degree) {
  assert_int_equal(pags_gaussians_add_fourier(g, degree), PAGS_OK);
  for (int p = 0; p < pags_fourier_planes(g); p++)
    for (int64_t i = 0; i < g->count; i++)
      g->fourier[p * g->stride + i] = (float)p + 0.01f * (float)i;
}

static void fourier_terms_follow_the_extras(void **state) {
  (void)state;
  pags_gaussians g, back;
  uint8_t *bytes;
  size_t size;
  sample_gaussians(&g, 300, 0, 3);
  assert_int_equal(pags_gaussians_add_object_id(&g), PAGS_OK);
  sample_fourier(&g, 0);
  assert_int_equal(pags_ply_save(scratch("f.ply"), &g), PAGS_OK);
  load(scratch("f.ply"), &back);
  assert_same(&g, &back);
  for (int p = 0; p < 12; p++)
    assert_memory_equal(g.fourier + p * g.stride, back.fourier + p * back.stride, 300 * sizeof(float));
  assert_int_equal(pags_ply_save(scratch("f2.ply"), &back), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("f.ply"), &bytes, &size), PAGS_OK);
  assert_non_null(
      strstr((char *)bytes, "property int object_id\nproperty float f_dc_t1_0\nproperty float f_dc_t1_1\n"));
  assert_file_holds(scratch("f2.ply"), bytes, size);
  free(bytes);
  pags_gaussians_destroy(&back);
  g.fourier[5 * g.stride + 7] = NAN;
  assert_int_equal(pags_ply_save(scratch("f.ply"), &g), PAGS_OK);
  load(scratch("f.ply"), &back);
  assert_int_equal(back.count, 299);
  assert_true(back.fourier[7] == g.fourier[8]);
  pags_gaussians_destroy(&back);
  pags_gaussians_destroy(&g);
}

/* Terms of every coefficient: no name may begin with f_rest_, which other programs count. */
static void fourier_terms_of_every_degree_round_trip(void **state) {
  (void)state;
  for (int degree = 1; degree <= 3; degree++) {
    pags_gaussians g, back;
    uint8_t *bytes;
    size_t size, named = 0;
    sample_gaussians(&g, 50, 3, 3);
    sample_fourier(&g, degree);
    assert_int_equal(pags_ply_save(scratch("f.ply"), &g), PAGS_OK);
    load(scratch("f.ply"), &back);
    assert_same(&g, &back);
    assert_int_equal(back.fourier_degree, degree);
    for (int p = 0; p < 12 * (degree + 1) * (degree + 1); p++)
      assert_memory_equal(g.fourier + p * g.stride, back.fourier + p * back.stride, 50 * sizeof(float));
    pags_gaussians_destroy(&back);
    assert_int_equal(pags_file_read(scratch("f.ply"), &bytes, &size), PAGS_OK);
    for (const char *at = (char *)bytes; (at = strstr(at, " f_rest_")); at++)
      named++;
    assert_int_equal(named, 45);
    assert_non_null(strstr((char *)bytes, "property float f_dc_t4_2\nproperty float f_sh1_t1_0\n"));
    if (degree == 2) {
      memcpy(strstr((char *)bytes, "f_sh5_t2_1"), "f_sh5_x2_1", 10);
      assert_int_equal(pags_ply_load(scratch_file("g.ply", bytes, size), &back), PAGS_ERROR_FORMAT);
      assert_non_null(
          strstr(pags_error_message(), "expected all of 'f_dc_t1_0' to 'f_sh8_t4_2' or none, no 'f_sh5_t2_1'"));
    }
    free(bytes);
    pags_gaussians_destroy(&g);
  }
}

static void incomplete_fourier_terms_are_refused(void **state) {
  (void)state;
  pags_gaussians g, back;
  uint8_t *bytes;
  size_t size;
  sample_gaussians(&g, 10, 0, 3);
  sample_fourier(&g, 0);
  assert_int_equal(pags_ply_save(scratch("f.ply"), &g), PAGS_OK);
  pags_gaussians_destroy(&g);
  assert_int_equal(pags_file_read(scratch("f.ply"), &bytes, &size), PAGS_OK);
  memcpy(strstr((char *)bytes, "f_dc_t3_1"), "f_dc_x3_1", 9);
  assert_int_equal(pags_ply_load(scratch_file("g.ply", bytes, size), &back), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "expected all of 'f_dc_t1_0' to 'f_dc_t4_2' or none, no 'f_dc_t3_1'"));
  free(bytes);
}

static void an_empty_file_round_trips(void **state) {
  (void)state;
  pags_gaussians g, back;
  assert_int_equal(pags_gaussians_create(&g, 0, 3), PAGS_OK);
  assert_int_equal(pags_ply_save(scratch("0.ply"), &g), PAGS_OK);
  load(scratch("0.ply"), &back);
  assert_int_equal(back.count, 0);
  assert_int_equal(back.sh_degree, 3);
}

/* Replaces the first occurrence of `from` by `to`, which may have another length. */
static void replace(file_bytes *file, const char *from, const char *to) {
  size_t length = strlen(from);
  for (size_t at = 0; at + length <= file->size; at++) {
    if (memcmp(file->data + at, from, length) == 0) {
      file_bytes out = {0};
      bytes_put(&out, file->data, at);
      bytes_text(&out, "%s", to);
      bytes_put(&out, file->data + at + length, file->size - at - length);
      bytes_free(file);
      *file = out;
      return;
    }
  }
  fail_msg("no '%s' in the file", from);
}

static void assert_edit_fails(const char *from, const char *to, pags_result code, const char *message) {
  pags_gaussians g, back;
  sample_gaussians(&g, 10, 1, 4);
  file_bytes file = make_ply(&g);
  replace(&file, from, to);
  assert_int_equal(pags_ply_load(scratch_file("bad.ply", file.data, file.size), &back), code);
  if (!strstr(pags_error_message(), message) || !strstr(pags_error_message(), "bad.ply"))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
  assert_null(back.data);
  bytes_free(&file);
  pags_gaussians_destroy(&g);
}

static void bad_headers_are_explained(void **state) {
  (void)state;
  assert_edit_fails("ply\n", "plx\n", PAGS_ERROR_FORMAT, "expected a PLY file");
  assert_edit_fails("format", "fromat", PAGS_ERROR_FORMAT, ":2: expected format, element");
  assert_edit_fails("little", "middle", PAGS_ERROR_FORMAT, ":2: expected ascii, binary_little_endian");
  assert_edit_fails("vertex 10", "vertex ten", PAGS_ERROR_FORMAT, ":3: expected 'element', a name and a count");
  assert_edit_fails("vertex 10", "vertex -1", PAGS_ERROR_FORMAT, ":3: expected 'element'");
  assert_edit_fails("element vertex 10\n", "", PAGS_ERROR_FORMAT, ":3: a property before any element");
  assert_edit_fails("vertex 10", "points 10", PAGS_ERROR_FORMAT, "expected an element 'vertex'");
  assert_edit_fails("float opacity", "half opacity", PAGS_ERROR_FORMAT, "expected 'property', a type and a name");
  assert_edit_fails("opacity", "rot_0", PAGS_ERROR_FORMAT, "a second property 'rot_0'");
  assert_edit_fails("scale_0", "scale_x", PAGS_ERROR_FORMAT, "no property 'scale_0'");
  assert_edit_fails("f_rest_8", "g_rest_8", PAGS_ERROR_FORMAT,
                    "expected 0, 9, 24, 45 or 72 properties f_rest_*, found 8");
  assert_edit_fails("f_rest_8", "f_rest_9", PAGS_ERROR_FORMAT, "no property 'f_rest_8'");
  assert_edit_fails("end_header\n", "end_headed\n", PAGS_ERROR_FORMAT, "expected 'end_header'");
  assert_edit_fails("element vertex", "element face 1\nproperty list uchar int v\nelement vertex",
                    PAGS_ERROR_UNSUPPORTED, "element 'face' has a list property");
}

static void absurd_counts_are_refused_without_allocating(void **state) {
  (void)state;
  assert_edit_fails("vertex 10", "vertex 11", PAGS_ERROR_FORMAT,
                    "truncated: expected 11 rows of 'vertex' (104 bytes each) from byte");
  assert_edit_fails("vertex 10", "vertex 9000000000000000000", PAGS_ERROR_FORMAT, "truncated");
  assert_edit_fails("vertex 10", "vertex 9223372036854775808", PAGS_ERROR_FORMAT, ":3: expected 'element'");
}

static void truncated_files_are_refused_with_the_place(void **state) {
  (void)state;
  pags_gaussians g, back;
  sample_gaussians(&g, 10, 3, 5);
  file_bytes file = make_ply(&g);
  char message[64];
  snprintf(message, sizeof message, "the file ends at byte %zu", file.size - 1);
  assert_int_equal(pags_ply_load(scratch_file("cut.ply", file.data, file.size - 1), &back), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), message));
  bytes_free(&file);
  pags_gaussians_destroy(&g);
}

static int lines_logged;
static char last_line[1024];

static void remember(void *user, pags_log_level level, const char *line) {
  (void)user;
  (void)level;
  lines_logged++;
  snprintf(last_line, sizeof last_line, "%s", line);
}

/* Rows with a NaN, or an infinite position, are left out; infinite opacities and scales of -inf are limits. */
static void rows_that_are_not_finite_are_left_out(void **state) {
  (void)state;
  pags_gaussians g, back;
  sample_gaussians(&g, 600, 3, 6);
  pags_plane(&g, PAGS_ROTATION + 2)[431] = NAN;
  pags_plane(&g, PAGS_MEAN)[432] = INFINITY;
  pags_plane(&g, PAGS_SCALE)[433] = INFINITY;
  pags_plane(&g, PAGS_OPACITY)[1] = INFINITY;
  pags_plane(&g, PAGS_OPACITY)[2] = -INFINITY;
  pags_plane(&g, PAGS_SCALE + 2)[3] = -INFINITY;
  file_bytes file = make_ply(&g);
  lines_logged = 0;
  pags_log_set(remember, NULL);
  load(scratch_file("nan.ply", file.data, file.size), &back);
  pags_log_set(NULL, NULL);
  assert_int_equal(lines_logged, 2);
  assert_non_null(strstr(last_line, "nan.ply: 3 of 600 Gaussians are left out"));
  assert_non_null(strstr(last_line, "the first is 431 (its rotation)"));
  assert_int_equal(back.count, 597);
  assert_true(pags_plane(&back, PAGS_MEAN)[430] == pags_plane(&g, PAGS_MEAN)[430]);
  assert_true(pags_plane(&back, PAGS_MEAN)[431] == pags_plane(&g, PAGS_MEAN)[434]);
  assert_true(pags_plane(&back, PAGS_OPACITY)[1] == 20 && pags_plane(&back, PAGS_OPACITY)[2] == -20);
  assert_true(pags_plane(&back, PAGS_SCALE + 2)[3] < -27 && isfinite(pags_plane(&back, PAGS_SCALE + 2)[3]));
  pags_gaussians_destroy(&back);
  bytes_free(&file);
  for (int i = 0; i < 600; i++)
    pags_plane(&g, PAGS_MEAN + 1)[i] = NAN;
  file = make_ply(&g);
  assert_int_equal(pags_ply_load(scratch_file("nan.ply", file.data, file.size), &back), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "Gaussian 0: expected finite numbers for its position"));
  bytes_free(&file);
  pags_gaussians_destroy(&g);
}

static void comments_hold_facts_of_the_scene(void **state) {
  (void)state;
  pags_gaussians g;
  pags_splat_facts facts = {.antialiased = 1, .up = PAGS_UP_Z, .origin = {500000.1, -4600000, 1e-3}}, back;
  sample_gaussians(&g, 10, 1, 6);
  g.alpha_min = 4.0f / 255.0f;
  assert_int_equal(pags_ply_save_facts(scratch("f.ply"), &g, &facts), PAGS_OK);
  pags_gaussians_destroy(&g);
  assert_int_equal(pags_splat_read(scratch("f.ply"), PAGS_AXES_UNKNOWN, &g, &back), PAGS_OK);
  assert_true(back.antialiased && back.up == PAGS_UP_Z);
  assert_memory_equal(back.origin, facts.origin, sizeof facts.origin);
  assert_true(g.alpha_min == 4.0f / 255.0f);
  pags_gaussians_destroy(&g);
}

/* A PLY of `count` Gaussians on a line near `far`, with coordinates x y z of a `type`; the third Gaussian is far
 * away. */
static file_bytes make_far_ply(int count, const double far[3], const char *comment, const char *type) {
  static const char *const rest[] = {"f_dc_0",  "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1",
                                     "scale_2", "rot_0",  "rot_1",  "rot_2",   "rot_3"};
  file_bytes file = {0};
  bytes_text(&file, "ply\nformat ascii 1.0\n%selement vertex %d\n", comment, count);
  bytes_text(&file, "property %s x\nproperty %s y\nproperty %s z\n", type, type, type);
  for (int k = 0; k < 11; k++)
    bytes_text(&file, "property float %s\n", rest[k]);
  bytes_text(&file, "end_header\n");
  for (int i = 0; i < count; i++)
    bytes_text(&file, "%.6f %.6f %.6f 0 0 0 1 -3 -3 -3 1 0 0 0\n", i == 2 ? 1e12 : far[0] + 0.001 * i,
               far[1] - 0.001 * i, far[2] + 0.002 * i);
  return file;
}

/* Large coordinates in double are read relative to an origin, to which an offset in a comment is added. Small
 * coordinates stay. */
static void large_coordinates_keep_their_digits(void **state) {
  (void)state;
  const double far[3] = {500000.25, -4600000, 120};
  file_bytes file = make_far_ply(50, far, "comment offset 10 20 30\n", "double");
  pags_splat_facts facts;
  pags_gaussians g;
  const char *const path = scratch_file("far.ply", file.data, file.size);
  assert_int_equal(pags_splat_read(path, PAGS_AXES_UNKNOWN, &g, &facts), PAGS_OK);
  assert_true(facts.origin[0] == 500010 && facts.origin[1] == -4599980 && facts.origin[2] == 30);
  assert_true(facts.taken_off[0] == 500000 && facts.taken_off[1] == -4600000 && facts.taken_off[2] == 0);
  for (int i = 0; i < 50; i++) {
    assert_true(i == 2 || fabs((double)pags_plane(&g, PAGS_MEAN)[i] - (0.25 + 0.001 * i)) < 1e-7);
    assert_true(fabs((double)pags_plane(&g, PAGS_MEAN + 1)[i] + 0.001 * i) < 1e-7);
    assert_true(pags_plane(&g, PAGS_MEAN + 2)[i] == (float)(120 + 0.002 * i));
  }
  pags_gaussians_destroy(&g);
  assert_int_equal(pags_splat_read(path, PAGS_AXES_RUB, &g, &facts),
                   PAGS_OK); /* y up and z back: the origin is turned as well */
  assert_true(facts.origin[0] == 500010 && facts.origin[1] == 4599980 && facts.origin[2] == -30);
  assert_true(fabs((double)pags_plane(&g, PAGS_MEAN + 1)[9] - 0.009) < 1e-7);
  pags_gaussians_destroy(&g);
  load(path, &g); /* this loader returns no origin */
  assert_true(pags_plane(&g, PAGS_MEAN + 1)[0] == -4600000);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  file = make_far_ply(50, far, "", "float"); /* text keeps all digits, whatever the stated type */
  assert_int_equal(pags_splat_read(scratch_file("text.ply", file.data, file.size), 0, &g, &facts), PAGS_OK);
  assert_true(facts.origin[1] == -4600000 && fabs((double)pags_plane(&g, PAGS_MEAN + 1)[9] + 0.009) < 1e-7);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  file = make_far_ply(50, (const double[3]){3000, -4000, 5}, "", "double");
  assert_int_equal(pags_splat_read(scratch_file("near.ply", file.data, file.size), 0, &g, &facts), PAGS_OK);
  assert_true(facts.origin[0] == 0 && facts.origin[1] == 0 && pags_plane(&g, PAGS_MEAN + 1)[0] == -4000);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
}

static void zero_quaternions_become_the_identity(void **state) {
  (void)state;
  pags_gaussians g, back;
  sample_gaussians(&g, 8, 0, 7);
  for (int k = 0; k < 4; k++)
    pags_plane(&g, PAGS_ROTATION + k)[2] = pags_plane(&g, PAGS_ROTATION + k)[7] = 0;
  file_bytes file = make_ply(&g);
  lines_logged = 0;
  pags_log_set(remember, NULL);
  load(scratch_file("q.ply", file.data, file.size), &back);
  pags_log_set(NULL, NULL);
  assert_int_equal(lines_logged, 1);
  assert_non_null(strstr(last_line, "q.ply: 2 all-zero quaternions"));
  assert_true(pags_plane(&back, PAGS_ROTATION)[7] == 1 && pags_plane(&back, PAGS_ROTATION + 1)[7] == 0);
  bytes_free(&file);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&back);
}

static void writing_to_a_bad_path_fails(void **state) {
  (void)state;
  pags_gaussians g;
  sample_gaussians(&g, 4, 0, 8);
  assert_int_equal(pags_ply_save(scratch("none/x.ply"), &g), PAGS_ERROR_IO);
  assert_int_equal(pags_ply_save("/dev/full/x.ply", &g), PAGS_ERROR_IO);
  pags_gaussians_destroy(&g);
}

static void inrias_file_round_trips(void **state) {
  (void)state;
  char path[1024];
  uint8_t *bytes;
  size_t size;
  pags_gaussians g;
  if (!pags_shared_data("splats/lod1_tile_0_0.5x.ply", path, sizeof path))
    skip();
  load(path, &g);
  assert_int_equal(g.count, 14051);
  assert_int_equal(pags_ply_save(scratch("lod.ply"), &g), PAGS_OK);
  assert_int_equal(pags_file_read(path, &bytes, &size), PAGS_OK);
  assert_file_holds(scratch("lod.ply"), bytes, size);
  free(bytes);
  pags_gaussians_destroy(&g);
}

/* A real file whose properties are in another order: every value is found by its name, and the file written again has
 * the same values in INRIA's order. */
static void a_scrambled_file_keeps_its_bits(void **state) {
  (void)state;
  char path[1024];
  pags_gaussians g, again;
  if (!pags_shared_data("splats/equinor_banana.ply", path, sizeof path))
    skip();
  load(path, &g);
  assert_int_equal(g.count, 11458);
  /* The values of a trained model: sigmas below 10 cm, and quaternions of about unit length. */
  for (int64_t i = 0; i < g.count; i++) {
    double norm = 0;
    for (int k = 0; k < 4; k++)
      norm += pow((double)pags_plane(&g, PAGS_ROTATION + k)[i], 2);
    assert_true(norm > 0.05 && norm < 16);
    assert_true(pags_plane(&g, PAGS_SCALE)[i] < -2.3f);
  }
  assert_int_equal(pags_ply_save(scratch("banana.ply"), &g), PAGS_OK);
  load(scratch("banana.ply"), &again);
  assert_same(&g, &again);
  pags_gaussians_destroy(&g);
  pags_gaussians_destroy(&again);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_degree_round_trips_to_the_byte),
      cmocka_unit_test(any_order_and_encoding_reads_the_same),
      cmocka_unit_test(extras_follow_the_standard_properties),
      cmocka_unit_test(fourier_terms_follow_the_extras),
      cmocka_unit_test(fourier_terms_of_every_degree_round_trip),
      cmocka_unit_test(incomplete_fourier_terms_are_refused),
      cmocka_unit_test(an_empty_file_round_trips),
      cmocka_unit_test(bad_headers_are_explained),
      cmocka_unit_test(absurd_counts_are_refused_without_allocating),
      cmocka_unit_test(truncated_files_are_refused_with_the_place),
      cmocka_unit_test(rows_that_are_not_finite_are_left_out),
      cmocka_unit_test(comments_hold_facts_of_the_scene),
      cmocka_unit_test(large_coordinates_keep_their_digits),
      cmocka_unit_test(zero_quaternions_become_the_identity),
      cmocka_unit_test(writing_to_a_bad_path_fails),
      cmocka_unit_test(inrias_file_round_trips),
      cmocka_unit_test(a_scrambled_file_keeps_its_bits),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
