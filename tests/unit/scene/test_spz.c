/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the reader of SPZ files, versions 2 to 4. */
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

static void load(const char *name, const file_bytes *file, pags_gaussians *g, const char **kind, int *antialiased) {
  if (pags_splat_load(scratch_file(name, file->data, file->size), g, kind, antialiased) != PAGS_OK)
    fail_msg("%s", pags_error_message());
}

static void kinds_and_flags_are_reported(void **state) {
  (void)state;
  static const char *const kinds[] = {"SPZ v2", "SPZ v3", "SPZ v4"};
  for (int version = 2; version <= 4; version++)
    for (int degree = 0; degree <= 4; degree++) {
      pags_gaussians g;
      const char *kind;
      int antialiased;
      spz_parts parts = make_spz_parts(version, 500, degree, 1);
      parts.flags = degree % 2;
      file_bytes file = pack_spz(&parts);
      load("a.spz", &file, &g, &kind, &antialiased);
      assert_string_equal(kind, kinds[version - 2]);
      assert_int_equal(antialiased, degree % 2);
      assert_int_equal(g.count, 500);
      assert_int_equal(g.sh_degree, degree > 3 ? 3 : degree);
      assert_int_equal(pags_gaussians_find_bad(&g, NULL), 0);
      /* A file of degree 4 has 24 coefficients for each Gaussian; degrees 0 to 3 are kept. */
      if (degree == 4)
        assert_true(plane(&g, PAGS_SH + 3 + 44, 7) == (parts.stream[5].data[7 * 72 + 44] - 128) / 128.0);
      pags_gaussians_destroy(&g);
      bytes_free(&file);
      free_spz_parts(&parts);
    }
}

static void known_bytes_decode(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(3, 1, 0, 1);
  /* 1.5, -2 and 0.25 in units of 1/4096; y and z change sign */
  const uint8_t position[9] = {0x00, 0x18, 0x00, 0x00, 0xE0, 0xFF, 0x00, 0x04, 0x00};
  memcpy(parts.stream[0].data, position, 9);
  parts.stream[1].data[0] = 51;
  parts.stream[2].data[1] = 204;
  parts.stream[3].data[2] = 96;
  /* w is the largest; x = -511/511, y = 255/511, z = 0 in units of sqrt 1/2 */
  pags_store_u32(parts.stream[4].data, 3u << 30 | (512u | 511u) << 20 | 255u << 10 | 0u);
  file_bytes file = pack_spz(&parts);
  pags_gaussians g;
  load("k.spz", &file, &g, NULL, NULL);
  assert_true(plane(&g, 0, 0) == 1.5 && plane(&g, 1, 0) == 2 && plane(&g, 2, 0) == -0.25);
  assert_true(fabs(sigmoid(plane(&g, PAGS_OPACITY, 0)) - 0.2) < 1e-6);
  assert_true(fabs(plane(&g, PAGS_SH + 1, 0) - 2) < 1e-6);
  assert_true(plane(&g, PAGS_SCALE + 2, 0) == -4);
  double x = -sqrt(0.5), y = sqrt(0.5) * 255 / 511;
  assert_true(fabs(plane(&g, PAGS_ROTATION, 0) - sqrt(1 - x * x - y * y)) < 1e-6);
  assert_true(fabs(plane(&g, PAGS_ROTATION + 1, 0) - x) < 1e-6);
  assert_true(fabs(plane(&g, PAGS_ROTATION + 2, 0) + y) < 1e-6);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  free_spz_parts(&parts);
}

/* The real spherical harmonics of degrees 1 to 3 with INRIA's signs and order (m ascending), without normalisation. */
static void basis(double x, double y, double z, double out[15]) {
  const double values[15] = {-y,
                             z,
                             -x,
                             x * y,
                             -y * z,
                             2 * z * z - x * x - y * y,
                             -x * z,
                             x * x - y * y,
                             -y * (3 * x * x - y * y),
                             x * y * z,
                             -y * (4 * z * z - x * x - y * y),
                             z * (2 * z * z - 3 * x * x - 3 * y * y),
                             -x * (4 * z * z - x * x - y * y),
                             z * (x * x - y * y),
                             -x * (x * x - 3 * y * y)};
  memcpy(out, values, sizeof values);
}

/* The colour seen from a direction is the same in the file's axes and in ours. */
static void sh_turns_with_the_axes(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(4, 50, 3, 2);
  file_bytes file = pack_spz(&parts);
  pags_gaussians g;
  load("sh.spz", &file, &g, NULL, NULL);
  double in_file[15], in_memory[15];
  basis(0.36, 0.48, 0.8, in_file);
  basis(0.36, -0.48, -0.8, in_memory);
  for (int64_t i = 0; i < 50; i++)
    for (int channel = 0; channel < 3; channel++) {
      double before = 0, after = 0;
      for (int k = 0; k < 15; k++) {
        before += in_file[k] * (parts.stream[5].data[45 * i + 3 * k + channel] - 128) / 128.0;
        after += in_memory[k] * plane(&g, PAGS_SH + 3 + 3 * k + channel, i);
      }
      assert_true(fabs(before - after) < 1e-6);
    }
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  free_spz_parts(&parts);
}

/* Half a turn of the axes about x flips y and z of a rotation's quaternion. Quaternions have unit length, or more
 * where the three random bytes of version 2 exceed it. */
static void rotations_turn_with_the_axes(void **state) {
  (void)state;
  for (int version = 2; version <= 4; version++) {
    spz_parts parts = make_spz_parts(version, 64, 0, 3);
    file_bytes file = pack_spz(&parts);
    pags_gaussians g;
    load("r.spz", &file, &g, NULL, NULL);
    for (int64_t i = 0; i < 64; i++) {
      double norm = 0;
      for (int k = 0; k < 4; k++)
        norm += pow(plane(&g, PAGS_ROTATION + k, i), 2);
      assert_true(norm > 1 - 1e-6);
    }
    if (version == 2) {
      const uint8_t *b = parts.stream[4].data;
      assert_true(fabs(plane(&g, PAGS_ROTATION + 1, 0) - (b[0] / 127.5 - 1)) < 1e-6);
      assert_true(fabs(plane(&g, PAGS_ROTATION + 2, 0) + (b[1] / 127.5 - 1)) < 1e-6);
      assert_true(fabs(plane(&g, PAGS_ROTATION + 3, 0) + (b[2] / 127.5 - 1)) < 1e-6);
    }
    pags_gaussians_destroy(&g);
    bytes_free(&file);
    free_spz_parts(&parts);
  }
}

static void assert_fails(const file_bytes *file, size_t size, pags_result code, const char *message) {
  pags_gaussians g;
  assert_int_equal(pags_splat_load(scratch_file("bad.spz", file->data, size), &g, NULL, NULL), code);
  if (!strstr(pags_error_message(), message) || !strstr(pags_error_message(), "bad.spz"))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
  assert_null(g.data);
}

static void bad_v4_files_are_explained(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(4, 1000, 1, 4);
  file_bytes file = pack_spz(&parts);
  const pags_result format = PAGS_ERROR_FORMAT;
  assert_fails(&file, 20, format, "truncated: expected a header of 32 bytes, found 20");
  assert_fails(&file, 100, format, "byte 16: expected the table of streams within the file's 100 bytes");
  assert_fails(&file, file.size - 1, format, "truncated: expected the SH from byte");
  file.data[8] ^= 1;
  assert_fails(&file, file.size, format, "byte 48: expected 9009 bytes of positions for 1001 Gaussians, found 9000");
  file.data[8] ^= 1;
  file.data[12] = 5;
  assert_fails(&file, file.size, format, "byte 12: expected an SH degree of 0 to 4, found 5");
  file.data[12] = 0;
  assert_fails(&file, file.size, format, "byte 15: expected 5 streams for SH degree 0, found 6");
  file.data[12] = 1;
  file.data[4] = 1;
  assert_fails(&file, file.size, PAGS_ERROR_UNSUPPORTED, "SPZ version 1");
  file.data[4] = 3;
  assert_fails(&file, file.size, format, "SPZ version 3 without gzip");
  file.data[4] = 4;
  file.data[40 + 96 + 20] ^= 255;
  file.data[40 + 96] ^= 255; /* damages the magic number of the zstd frame */
  assert_fails(&file, file.size, format, "the zstd data of the positions are damaged");
  bytes_free(&file);
  free_spz_parts(&parts);
}

static void bad_gzip_files_are_explained(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(3, 1000, 0, 5);
  file_bytes file = pack_spz(&parts);
  assert_fails(&file, file.size / 2, PAGS_ERROR_FORMAT, "the gzip data ends");
  assert_fails(&file, file.size - 1, PAGS_ERROR_FORMAT, "expected the end of the gzip data");
  file.data[file.size - 8] ^= 1; /* damages the checksum */
  assert_fails(&file, file.size, PAGS_ERROR_FORMAT, "expected the end of the gzip data");
  bytes_free(&file);
  parts.count = 4000000000u;
  file = pack_spz(&parts);
  assert_fails(&file, file.size, PAGS_ERROR_FORMAT, "4000000000 Gaussians can't be in");
  bytes_free(&file);
  free_spz_parts(&parts);
}

/* Zeros compress by a factor of a thousand: the reader must not inflate more bytes than the count requires. */
static void bombs_are_refused(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(3, 10, 0, 6);
  static const uint8_t zeros[1 << 16];
  for (int i = 0; i < 1024; i++) /* 64 MB of zeros */
    bytes_put(&parts.stream[5], zeros, sizeof zeros);
  file_bytes file = pack_spz(&parts);
  assert_fails(&file, file.size, PAGS_ERROR_FORMAT, "expected the end of the gzip data");
  bytes_free(&file);
  parts.flags = 2; /* a flag by which the extra bytes would be extensions */
  file = pack_spz(&parts);
  assert_fails(&file, file.size, PAGS_ERROR_FORMAT, "expected the end of the gzip data");
  bytes_free(&file);
  free_spz_parts(&parts);
}

static void extension_records_are_skipped(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(2, 10, 0, 7);
  bytes_text(&parts.stream[5], "records of some kind");
  parts.flags = 2;
  file_bytes file = pack_spz(&parts);
  pags_gaussians g;
  load("x.spz", &file, &g, NULL, NULL);
  assert_int_equal(g.count, 10);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  free_spz_parts(&parts);
}

/* The record of the coordinate system names the file's axes, wherever it stands in the file; an option overrides it.
 * Expected values come from the same bytes read as RUB and turned. */
static void the_record_sets_the_axes(void **state) {
  (void)state;
  for (int version = 3; version <= 4; version++) {
    spz_parts parts = make_spz_parts(version, 10, 3, 7);
    file_bytes plain = pack_spz(&parts), file;
    pags_gaussians rub, g;
    pags_splat_facts facts;
    load("rub.spz", &plain, &rub, NULL, NULL);
    const uint32_t record[3] = {0xADBE0003, 4, PAGS_AXES_RDF};
    if (version == 3) {
      for (int i = 0; i < 3; i++)
        bytes_u32(&parts.stream[5], record[i]);
      parts.flags = 2;
      file = pack_spz(&parts);
    } else {
      file = (file_bytes){0};
      bytes_put(&file, plain.data, 32);
      for (int i = 0; i < 3; i++)
        bytes_u32(&file, record[i]);
      bytes_put(&file, plain.data + 32, plain.size - 32);
      file.data[14] = 2;
      file.data[16] = 52; /* the table follows this record and the one that pack_spz writes */
    }
    if (pags_splat_read(scratch_file("rdf.spz", file.data, file.size), 0, &g, &facts) != PAGS_OK)
      fail_msg("%s", pags_error_message());
    assert_int_equal(facts.axes, PAGS_AXES_RDF);
    assert_string_equal(facts.axes_from, "record");
    for (int64_t i = 0; i < g.count; i++) {
      assert_true(plane(&g, 0, i) == plane(&rub, 0, i) && plane(&g, 1, i) == -plane(&rub, 1, i));
      assert_true(plane(&g, PAGS_ROTATION + 3, i) == -plane(&rub, PAGS_ROTATION + 3, i));
      assert_true(plane(&g, PAGS_SH + 3, i) == -plane(&rub, PAGS_SH + 3, i));
    }
    pags_gaussians_destroy(&g);
    assert_int_equal(pags_splat_read(scratch_file("rdf.spz", file.data, file.size), PAGS_AXES_RUB, &g, &facts),
                     PAGS_OK);
    assert_string_equal(facts.axes_from, "option");
    for (int64_t i = 0; i < g.count; i++)
      assert_true(plane(&g, 1, i) == plane(&rub, 1, i));
    pags_gaussians_destroy(&g);
    pags_gaussians_destroy(&rub);
    bytes_free(&plain);
    bytes_free(&file);
    free_spz_parts(&parts);
  }
}

/* Coordinate systems with y forward or back: a Gaussian and its colours are turned to the right place. */
static void axes_with_z_up_are_turned(void **state) {
  (void)state;
  spz_parts parts = make_spz_parts(4, 20, 3, 9);
  file_bytes file = pack_spz(&parts);
  pags_gaussians raw, g;
  const char *const path = scratch_file("rfu.spz", file.data, file.size);
  assert_int_equal(pags_splat_read(path, PAGS_AXES_RDF, &raw, NULL), PAGS_OK);
  assert_int_equal(pags_splat_read(path, PAGS_AXES_RFU, &g, NULL), PAGS_OK); /* x right, y forward, z up */
  double in_file[15], in_memory[15];
  basis(0.36, 0.48, 0.8, in_file);
  basis(0.36, -0.8, 0.48, in_memory);
  for (int64_t i = 0; i < g.count; i++) {
    assert_true(plane(&g, 0, i) == plane(&raw, 0, i) && plane(&g, 1, i) == -plane(&raw, 2, i) &&
                plane(&g, 2, i) == plane(&raw, 1, i));
    double a = 0, b = 0;
    static const double c1 = 0.4886025119029199;
    static const double factors[15] = {c1,
                                       c1,
                                       c1,
                                       1.0925484305920792,
                                       1.0925484305920792,
                                       0.31539156525252005,
                                       1.0925484305920792,
                                       0.5462742152960396,
                                       0.5900435899266435,
                                       2.890611442640554,
                                       0.4570457994644658,
                                       0.3731763325901154,
                                       0.4570457994644658,
                                       1.445305721320277,
                                       0.5900435899266435};
    for (int k = 0; k < 15; k++) {
      a += factors[k] * in_file[k] * plane(&raw, PAGS_SH + 3 + 3 * k, i);
      b += factors[k] * in_memory[k] * plane(&g, PAGS_SH + 3 + 3 * k, i);
    }
    assert_true(fabs(a - b) < 1e-5);
  }
  pags_gaussians_destroy(&raw);
  pags_gaussians_destroy(&g);
  bytes_free(&file);
  free_spz_parts(&parts);
}

static void an_empty_file_reads(void **state) {
  (void)state;
  for (int version = 2; version <= 4; version++) {
    spz_parts parts = make_spz_parts(version, 0, 0, 8);
    file_bytes file = pack_spz(&parts);
    pags_gaussians g;
    load("0.spz", &file, &g, NULL, NULL);
    assert_int_equal(g.count, 0);
    bytes_free(&file);
    free_spz_parts(&parts);
  }
}

/* Returns half the angle in radians between the rotations of row i. */
static double half_angle(const pags_gaussians *a, const pags_gaussians *b, int64_t i) {
  double dot = 0, aa = 0, bb = 0;
  for (int k = 0; k < 4; k++) {
    double p = plane(a, PAGS_ROTATION + k, i), q = plane(b, PAGS_ROTATION + k, i);
    dot += p * q;
    aa += p * p;
    bb += q * q;
  }
  return acos(fmin(1, fabs(dot) / sqrt(aa * bb)));
}

/* Two files of the same model in lossy formats, in the same order: each field differs by at most half of the sum of
 * both quantisation steps. */
static void two_formats_of_one_model_agree(void **state) {
  (void)state;
  char spz[1024], ply[1024];
  if (!pags_shared_data("splats/biker.spz", spz, sizeof spz) ||
      !pags_shared_data("splats/biker.compressed.ply", ply, sizeof ply))
    skip();
  pags_gaussians a, b;
  const char *kind;
  assert_int_equal(pags_splat_load(spz, &a, &kind, NULL), PAGS_OK);
  assert_string_equal(kind, "SPZ v4");
  assert_int_equal(pags_splat_load(ply, &b, NULL, NULL), PAGS_OK);
  assert_int_equal(a.count, 152746);
  assert_int_equal(b.count, 152746);
  for (int64_t i = 0; i < a.count; i++) {
    for (int k = 0; k < 3; k++) {
      assert_true(fabs(plane(&a, k, i) - plane(&b, k, i)) < 0.00025);
      double scale = fmax(-10, plane(&b, PAGS_SCALE + k, i)); /* SPZ's lower limit of ln sigma */
      assert_true(fabs(plane(&a, PAGS_SCALE + k, i) - scale) < 0.035);
      assert_true(fabs(plane(&a, PAGS_SH + k, i) - plane(&b, PAGS_SH + k, i)) < 0.02);
    }
    assert_true(fabs(sigmoid(plane(&a, PAGS_OPACITY, i)) - sigmoid(plane(&b, PAGS_OPACITY, i))) < 0.5 / 255);
    assert_true(half_angle(&a, &b, i) < 0.002);
  }
  pags_gaussians_destroy(&a);
  pags_gaussians_destroy(&b);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(kinds_and_flags_are_reported),
      cmocka_unit_test(known_bytes_decode),
      cmocka_unit_test(sh_turns_with_the_axes),
      cmocka_unit_test(rotations_turn_with_the_axes),
      cmocka_unit_test(bad_v4_files_are_explained),
      cmocka_unit_test(bad_gzip_files_are_explained),
      cmocka_unit_test(bombs_are_refused),
      cmocka_unit_test(extension_records_are_skipped),
      cmocka_unit_test(an_empty_file_reads),
      cmocka_unit_test(the_record_sets_the_axes),
      cmocka_unit_test(axes_with_z_up_are_turned),
      cmocka_unit_test(two_formats_of_one_model_agree),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
