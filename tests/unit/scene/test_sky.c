/* SPDX-License-Identifier: Apache-2.0 */
/* Tests the sky's cube map: half precision, its files, faces and directions. */
#include <pags/sky.h>

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/half.h"
#include "base/memory.h"
#include "base/zip.h"
#include "scratch_folder.h"

#include <cmocka.h>

/* Returns the value of a half-precision number by the definition of the format. */
static double half_value(unsigned half) {
  int exponent = (int)(half >> 10 & 31);
  double mantissa = half & 1023, sign = half & 0x8000 ? -1 : 1;
  return sign * (exponent == 0 ? ldexp(mantissa, -24) : ldexp(1024 + mantissa, exponent - 25));
}

static void every_half_round_trips(void **state) {
  (void)state;
  for (unsigned half = 0; half < 65536; half++) {
    float value = pags_float_from_half((uint16_t)half);
    if ((half & 0x7C00) == 0x7C00 && (half & 0x3FF)) {
      assert_true(isnan(value) && isnan(pags_float_from_half(pags_half_from_float(value))));
      continue;
    }
    if ((half & 0x7C00) == 0x7C00)
      assert_true(isinf(value) && (value < 0) == (half > 0x8000));
    else
      assert_true((double)value == half_value(half));
    assert_int_equal(pags_half_from_float(value), half);
  }
}

static void halves_are_the_nearest_with_ties_to_even(void **state) {
  (void)state;
  for (unsigned half = 0; half < 0x7BFF; half++) {
    double lo = half_value(half), hi = half_value(half + 1), middle = 0.5 * (lo + hi);
    unsigned even = half & 1 ? half + 1 : half;
    /* A midpoint needs 12 bits, so it is exact in float. */
    assert_int_equal(pags_half_from_float((float)middle), even);
    assert_int_equal(pags_half_from_float(nextafterf((float)middle, 0)), half);
    assert_int_equal(pags_half_from_float(nextafterf((float)middle, INFINITY)), half + 1);
    assert_int_equal(pags_half_from_float(-(float)middle), even | 0x8000);
  }
  assert_int_equal(pags_half_from_float(65519.996f), 0x7BFF);
  assert_int_equal(pags_half_from_float(65520.0f), 0x7C00);
  assert_int_equal(pags_half_from_float(1e-30f), 0);
}

static void fill(pags_sky *sky, int size) {
  assert_int_equal(pags_sky_create(sky, size), PAGS_OK);
  for (int i = 0; i < 18 * size * size; i++)
    sky->texels[i] = (float)i / 256;
}

/* A loaded sky stores its lowest value below 0, which bounded Early-Z needs. */
static void a_loaded_sky_stores_its_lowest_value(void **state) {
  (void)state;
  const float least[] = {0.0f, -0.5f, -100.0f}, dips[] = {0.0f, 0.25f, 1.0f};
  for (int i = 0; i < 3; i++) {
    pags_sky sky, back;
    fill(&sky, 1);
    sky.texels[3] = least[i];
    sky.texels[17] = 2.0f;
    assert_int_equal(pags_sky_save(scratch("dip.npy"), &sky), PAGS_OK);
    assert_int_equal(pags_sky_load(scratch("dip.npy"), &back), PAGS_OK);
    assert_true(back.dip == dips[i]);
    pags_sky_destroy(&sky);
    pags_sky_destroy(&back);
  }
}

static void a_sky_round_trips(void **state) {
  (void)state;
  pags_sky sky, back;
  uint8_t *bytes[2];
  size_t sizes[2];
  fill(&sky, 5);
  assert_int_equal(pags_sky_save(scratch("a.npy"), &sky), PAGS_OK);
  assert_int_equal(pags_sky_load(scratch("a.npy"), &back), PAGS_OK);
  assert_int_equal(back.size, 5);
  assert_memory_equal(back.texels, sky.texels, 18 * 25 * sizeof(float));
  assert_int_equal(pags_sky_save(scratch("b.npy"), &back), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("a.npy"), &bytes[0], &sizes[0]), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("b.npy"), &bytes[1], &sizes[1]), PAGS_OK);
  assert_int_equal(sizes[0], 128 + 18 * 25 * 2);
  assert_int_equal(sizes[0], sizes[1]);
  assert_memory_equal(bytes[0], bytes[1], sizes[0]);
  assert_memory_equal(bytes[0],
                      "\x93NUMPY\x01\x00\x76\x00{'descr': '<f2', 'fortran_order': False, 'shape': (6, 5, 5, 3), }", 75);
  free(bytes[0]);
  free(bytes[1]);
  pags_sky_destroy(&sky);
  pags_sky_destroy(&back);
  assert_null(back.texels);
}

static void assert_refused(const char *text, size_t at, const char *to, pags_result code, const char *message) {
  pags_sky sky;
  uint8_t *bytes;
  size_t size;
  fill(&sky, 2);
  assert_int_equal(pags_sky_save(scratch("c.npy"), &sky), PAGS_OK);
  pags_sky_destroy(&sky);
  assert_int_equal(pags_file_read(scratch("c.npy"), &bytes, &size), PAGS_OK);
  if (text)
    at = (size_t)(strstr((char *)bytes + 10, text) - (char *)bytes);
  memcpy(bytes + at, to, strlen(to));
  assert_int_equal(pags_sky_load(scratch_file("d.npy", bytes, size), &sky), code);
  if (!strstr(pags_error_message(), message) || !strstr(pags_error_message(), "d.npy"))
    fail_msg("expected '%s' in '%s'", message, pags_error_message());
  assert_null(sky.texels);
  free(bytes);
}

static void bad_files_are_explained(void **state) {
  (void)state;
  assert_refused(NULL, 0, "XX", PAGS_ERROR_FORMAT, "expected an npy array of version 1 to 3");
  assert_refused(NULL, 0, "PK\3\4", PAGS_ERROR_FORMAT, "expected a zip archive, found no end record");
  assert_refused(NULL, 8, "\xff\xff", PAGS_ERROR_FORMAT, "the npy header is cut off");
  assert_refused("'descr'", 0, "'descx'", PAGS_ERROR_FORMAT, "expected 'descr'");
  assert_refused("<f2", 0, "<f4", PAGS_ERROR_UNSUPPORTED, "expected little-endian float16");
  assert_refused("False", 0, "True ", PAGS_ERROR_UNSUPPORTED, "in C order");
  assert_refused("(6, 2", 0, "(5, 2", PAGS_ERROR_FORMAT, "found (5, 2, 2, 3)");
  assert_refused("(6, 2", 0, "(6, 3", PAGS_ERROR_FORMAT, "found (6, 3, 2, 3)");
  assert_refused("(6, 2, 2", 0, "(6, 9, 9", PAGS_ERROR_FORMAT,
                 "expected 2916 bytes of texels from byte 128, found 144");
  assert_refused(NULL, 130, "\x01\x7C", PAGS_ERROR_FORMAT, "expected finite numbers, found nan at byte 130");
  pags_sky sky;
  fill(&sky, 1);
  sky.texels[4] = 1e6f;
  assert_int_equal(pags_sky_save(scratch("e.npy"), &sky), PAGS_ERROR_ARGUMENT);
  assert_false(pags_file_exists(scratch("e.npy")));
  pags_sky_destroy(&sky);
}

/* An archive has the array that NumPy reads, and takes little space where texels have one colour. */
static void an_archive_round_trips(void **state) {
  (void)state;
  PAGS_AUTO(pags_zip_close) pags_zip zip = {0};
  pags_sky sky, back;
  uint8_t *archive, *array, *plain;
  size_t size, plain_size;
  uint64_t said;
  assert_int_equal(pags_sky_create(&sky, 64), PAGS_OK);
  for (int i = 0; i < 3 * 640; i++) /* ten rows of the first face */
    sky.texels[i] = (float)(i * i % 1021) / 1024;
  assert_int_equal(pags_sky_save(scratch("a.npz"), &sky), PAGS_OK);
  assert_int_equal(pags_sky_load(scratch("a.npz"), &back), PAGS_OK);
  assert_int_equal(back.size, 64);
  assert_memory_equal(back.texels, sky.texels, 18 * 64 * 64 * sizeof(float));

  assert_int_equal(pags_file_read(scratch("a.npz"), &archive, &size), PAGS_OK);
  assert_int_equal(pags_sky_file_size(&sky, &said), PAGS_OK);
  assert_int_equal(said, size);
  assert_true(size < 640 * 6 + 1500); /* the rest, 143 kB, is even */
  assert_int_equal(pags_zip_open(archive, size, "a.npz", &zip), PAGS_OK);
  assert_int_equal(zip.count, 1);
  assert_int_equal(pags_zip_read(&zip, pags_zip_find(&zip, "sky.npy"), &array), PAGS_OK);
  assert_int_equal(pags_sky_save(scratch("a.npy"), &sky), PAGS_OK);
  assert_int_equal(pags_file_read(scratch("a.npy"), &plain, &plain_size), PAGS_OK);
  assert_int_equal(zip.members[0].size, plain_size);
  assert_memory_equal(array, plain, plain_size);

  archive[size / 2] ^= 1;
  assert_int_equal(pags_sky_load(scratch_file("b.npz", archive, size), &back), PAGS_ERROR_FORMAT);
  assert_null(back.texels);
  assert_non_null(strstr(pags_error_message(), "b.npz"));
  archive[size / 2] ^= 1;
  archive[30] = archive[size - 22 - 7] = 'S'; /* the member's name, in both records */
  assert_int_equal(pags_sky_load(scratch_file("c.npz", archive, size), &back), PAGS_ERROR_FORMAT);
  assert_non_null(strstr(pags_error_message(), "expected an npz archive with a member 'sky.npy'"));
  free(archive);
  free(array);
  free(plain);
  pags_sky_destroy(&sky);
}

/* The direction to the centre of texel (i, j) of each face, by OpenGL's table of cube map faces, gives that texel's
 * colour. */
static void directions_meet_their_texels(void **state) {
  (void)state;
  enum { SIZE = 4 };
  pags_sky sky;
  fill(&sky, SIZE);
  for (int face = 0; face < 6; face++)
    for (int i = 0; i < SIZE; i++)
      for (int j = 0; j < SIZE; j++) {
        double s = 2 * (j + 0.5) / SIZE - 1, t = 2 * (i + 0.5) / SIZE - 1;
        const double all[6][3] = {{1, -t, -s}, {-1, -t, s}, {s, 1, t}, {s, -1, -t}, {s, -t, 1}, {-s, -t, -1}};
        double direction[3] = {7 * all[face][0], 7 * all[face][1], 7 * all[face][2]};
        float rgb[3];
        pags_sky_sample(&sky, direction, rgb);
        for (int c = 0; c < 3; c++)
          assert_float_equal(rgb[c], sky.texels[((face * SIZE + i) * SIZE + j) * 3 + c], 1e-5);
      }
  float rgb[3]; /* Bilinear between four texels, and clamped beyond the texel centres at a corner. */
  pags_sky_sample(&sky, (double[]){1, 0, 0}, rgb);
  assert_float_equal(rgb[0], (5 + 6 + 9 + 10) / 4.0 * 3 / 256, 1e-5);
  pags_sky_sample(&sky, (double[]){1, 0.999, 0.999}, rgb);
  assert_float_equal(rgb[0], 0, 1e-5);
  pags_sky_destroy(&sky);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(every_half_round_trips),  cmocka_unit_test(halves_are_the_nearest_with_ties_to_even),
      cmocka_unit_test(a_sky_round_trips),       cmocka_unit_test(a_loaded_sky_stores_its_lowest_value),
      cmocka_unit_test(bad_files_are_explained), cmocka_unit_test(directions_meet_their_texels),
      cmocka_unit_test(an_archive_round_trips),
  };
  return cmocka_run_group_tests(tests, scratch_setup, scratch_teardown);
}
