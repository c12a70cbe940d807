/* SPDX-License-Identifier: Apache-2.0 */
/* Tests colour spaces of pictures: ICC profiles, code points and primaries, converted to sRGB. The expected colours
 * are published values of sRGB's primaries in other spaces. */
#include "image/colour.h"

#include "base/file.h"
#include "image/formats.h"
#include "image/other.h"
#include "unit/scratch.h"

#include <math.h>
#include <zlib.h>

/* ---- ICC profiles ---- */

typedef struct profile {
  uint8_t bytes[8192];
  size_t size;
} profile;

static void put(profile *p, uint32_t value, int bytes) {
  for (int i = bytes - 1; i >= 0; i--)
    p->bytes[p->size++] = (uint8_t)(value >> 8 * i);
}

static void put_text(profile *p, const char *text) {
  while (*text)
    p->bytes[p->size++] = (uint8_t)*text++;
}

static void put_fixed(profile *p, double value) {
  put(p, (uint32_t)(int32_t)lround(value * 65536), 4);
}

typedef enum curve_kind { GAMMA, FORMULA, TABLE } curve_kind;

static void put_curve(profile *p, curve_kind kind, double gamma) {
  static const double srgb[] = {2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045};
  put_text(p, kind == FORMULA ? "para" : "curv");
  put(p, 0, 4);
  if (kind == FORMULA) {
    put(p, 3 << 16, 4);
    for (int i = 0; i < 5; i++)
      put_fixed(p, srgb[i]);
    return;
  }
  put(p, kind == TABLE ? 1024 : 1, 4);
  if (kind == GAMMA)
    put(p, (uint32_t)lround(gamma * 256), 2);
  for (int i = 0; kind == TABLE && i < 1024; i++) {
    const double v = i / 1023.0;
    put(p, (uint32_t)lround(65535 * (v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4))), 2);
  }
}

static const double display_p3[9] = {0.51512, 0.29198, 0.15710, 0.24120, 0.69225, 0.06657, -0.00105, 0.04189, 0.78407};
static const double adobe_rgb[9] = {0.60974, 0.20528, 0.14919, 0.31111, 0.62567, 0.06322, 0.01947, 0.06087, 0.74457};
static const double srgb[9] = {0.43607, 0.38515, 0.14307, 0.22249, 0.71687, 0.06061, 0.01392, 0.09708, 0.71410};

/* A profile with a matrix (NULL: none) and a curve. */
static profile make_profile(const char *space, const double *matrix, curve_kind kind, double gamma) {
  static const char *const tags[] = {"desc", "rXYZ", "gXYZ", "bXYZ", "rTRC", "gTRC", "bTRC", "kTRC"};
  profile p = {.size = 128};
  size_t places[8];
  memcpy(p.bytes + 12, "mntr", 4);
  memcpy(p.bytes + 16, space, 4);
  memcpy(p.bytes + 20, "XYZ ", 4);
  memcpy(p.bytes + 36, "acsp", 4);
  p.size = 68; /* white point D50 */
  put_fixed(&p, 0.9642);
  put_fixed(&p, 1);
  put_fixed(&p, 0.8249);
  p.size = 128;
  put(&p, 8, 4);
  p.size += 12 * 8;
  for (int i = 0; i < 8; i++) {
    places[i] = p.size;
    if (i == 0) {
      put_text(&p, "desc");
      put(&p, 0, 4);
      put(&p, 5, 4);
      put_text(&p, "Named");
    } else if (i < 4 && matrix) {
      put_text(&p, "XYZ ");
      put(&p, 0, 4);
      for (int k = 0; k < 3; k++)
        put_fixed(&p, matrix[3 * k + i - 1]);
    } else if (i == 4) {
      put_curve(&p, kind, gamma);
    } else if (i > 4) {
      places[i] = places[4];
    }
    while (p.size % 4)
      put(&p, 0, 1);
  }
  const size_t size = p.size;
  for (size_t i = 0; i < 8; i++) {
    const size_t end = i < 4 ? places[i + 1] : size;
    p.size = 132 + 12 * i;
    put_text(&p, matrix || i == 0 || i == 7 ? tags[i] : "none");
    put(&p, (uint32_t)places[i], 4);
    put(&p, (uint32_t)(end - places[i]), 4);
  }
  p.size = 0;
  put(&p, (uint32_t)size, 4);
  p.size = size;
  return p;
}

/* ---- Checks ---- */

/* Converts one pixel of each sample type and expects a colour within one level. A channel of 0 may be five levels
 * off, as published colours are rounded and the curve is steep there. */
static void expect(const pags_colour *colour, const uint8_t from[3], const uint8_t to[3]) {
  for (pags_sample sample = PAGS_U8; sample <= (colour->encoded ? PAGS_F32 : PAGS_U16); sample++) {
    pags_image image;
    scratch_ok(pags_image_create(&image, 1, 1, 4, sample));
    for (int c = 0; c < 4; c++) {
      const int value = c < 3 ? from[c] : 200;
      if (sample == PAGS_U8)
        ((uint8_t *)image.data)[c] = (uint8_t)value;
      else if (sample == PAGS_U16)
        ((uint16_t *)image.data)[c] = (uint16_t)(257 * value);
      else
        ((float *)image.data)[c] = (float)value / 255;
    }
    scratch_ok(pags_colour_convert(colour, "a.png", &image));
    assert_true(image.sample == PAGS_U8 && image.channels == 4);
    for (int c = 0; c < 3; c++)
      assert_in_range(((uint8_t *)image.data)[c] + 1, to[c], to[c] + (to[c] == 0 ? 6 : 2));
    assert_int_equal(((uint8_t *)image.data)[3], 200);
    pags_image_destroy(&image);
  }
}

static void test_profiles(void **state) {
  (void)state;
  pags_colour colour;
  profile p = make_profile("RGB ", display_p3, FORMULA, 0);
  pags_colour_set_icc(&colour, p.bytes, p.size);
  assert_int_equal(colour.kind, PAGS_COLOUR_OTHER);
  assert_string_equal(colour.name, "Named");
  expect(&colour, (const uint8_t[]){234, 51, 35}, (const uint8_t[]){255, 0, 0});
  expect(&colour, (const uint8_t[]){117, 251, 76}, (const uint8_t[]){0, 255, 0});
  expect(&colour, (const uint8_t[]){0, 0, 245}, (const uint8_t[]){0, 0, 255});
  expect(&colour, (const uint8_t[]){128, 128, 128}, (const uint8_t[]){128, 128, 128});
  p = make_profile("RGB ", adobe_rgb, GAMMA, 2.19921875);
  pags_colour_set_icc(&colour, p.bytes, p.size);
  expect(&colour, (const uint8_t[]){219, 0, 0}, (const uint8_t[]){255, 0, 0});
  expect(&colour, (const uint8_t[]){144, 255, 60}, (const uint8_t[]){0, 255, 0});
  p = make_profile("RGB ", srgb, GAMMA, 1);
  pags_colour_set_icc(&colour, p.bytes, p.size);
  expect(&colour, (const uint8_t[]){128, 55, 1}, (const uint8_t[]){188, 128, 13});
  p = make_profile("GRAY", NULL, GAMMA, 1);
  pags_colour_set_icc(&colour, p.bytes, p.size);
  expect(&colour, (const uint8_t[]){55, 55, 55}, (const uint8_t[]){128, 128, 128});
  for (curve_kind kind = FORMULA; kind <= TABLE; kind++) {
    p = make_profile("RGB ", srgb, kind, 0);
    pags_colour_set_icc(&colour, p.bytes, p.size);
    assert_int_equal(colour.kind, PAGS_COLOUR_SRGB);
  }
}

static void expect_refused(const pags_colour *colour, const char *words) {
  pags_image image;
  assert_int_equal(colour->kind, PAGS_COLOUR_UNKNOWN);
  scratch_ok(pags_image_create(&image, 1, 1, 3, PAGS_U8));
  scratch_expect(pags_colour_convert(colour, "a.png", &image), PAGS_ERROR_FORMAT, words);
  pags_image_destroy(&image);
}

static void test_what_is_not_converted(void **state) {
  (void)state;
  pags_colour colour;
  profile p = make_profile("CMYK", NULL, GAMMA, 1);
  pags_colour_set_icc(&colour, p.bytes, p.size);
  expect_refused(&colour, "a.png: its colours are in a space that is not converted here (Named)");
  p = make_profile("RGB ", NULL, GAMMA, 1); /* only tables */
  pags_colour_set_icc(&colour, p.bytes, p.size);
  expect_refused(&colour, "magick");
  pags_colour_set_icc(&colour, p.bytes, 100);
  expect_refused(&colour, "a damaged ICC profile");
  p = make_profile("RGB ", srgb, FORMULA, 0);
  for (size_t size = 0; size < p.size; size++) { /* cut at every byte */
    pags_colour_set_icc(&colour, p.bytes, size);
    assert_int_equal(colour.kind, PAGS_COLOUR_UNKNOWN);
  }
  pags_colour_set_cicp(&colour, 9, 16, true);
  expect_refused(&colour, "(BT.2020, PQ (HDR))");
  pags_colour_set_cicp(&colour, 9, 18, true);
  expect_refused(&colour, "(BT.2020, HLG (HDR))");
  pags_colour_set_cicp(&colour, 1, 13, false);
  expect_refused(&colour, "narrow range");
  pags_colour_set_cicp(&colour, 99, 13, true);
  expect_refused(&colour, "other primaries");
}

static void test_numbers(void **state) {
  (void)state;
  pags_colour colour;
  pags_colour_set_cicp(&colour, 1, 13, true);
  assert_int_equal(colour.kind, PAGS_COLOUR_SRGB);
  pags_colour_set_cicp(&colour, 12, 13, true);
  assert_string_equal(colour.name, "Display P3");
  expect(&colour, (const uint8_t[]){234, 51, 35}, (const uint8_t[]){255, 0, 0});
  pags_colour_set_cicp(&colour, 1, 1, true);
  expect(&colour, (const uint8_t[]){21, 128, 255}, (const uint8_t[]){37, 140, 255}); /* the curve of BT.709 */
  pags_colour_set_gamma(&colour, 1 / 0.45455, NULL, NULL);
  assert_int_equal(colour.kind, PAGS_COLOUR_SRGB);
  pags_colour_set_gamma(&colour, 1, NULL, NULL);
  expect(&colour, (const uint8_t[]){55, 55, 55}, (const uint8_t[]){128, 128, 128});
  pags_colour_set_adobe_rgb(&colour);
  expect(&colour, (const uint8_t[]){219, 0, 0}, (const uint8_t[]){255, 0, 0});
}

/* Linear light: some of ACES' primaries lie outside of the spectrum. White stays white for any white point. */
static void test_primaries_of_light(void **state) {
  (void)state;
  static const double aces[8] = {0.7347, 0.2653, 0, 1, 0.0001, -0.077, 0.32168, 0.33767};
  static const double bt709[8] = {0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290};
  pags_colour colour;
  pags_image image;
  pags_colour_set_primaries(&colour, bt709);
  assert_int_equal(colour.kind, PAGS_COLOUR_SRGB);
  pags_colour_set_primaries(&colour, aces);
  assert_int_equal(colour.kind, PAGS_COLOUR_OTHER);
  scratch_ok(pags_image_create(&image, 2, 1, 3, PAGS_F32));
  /* sRGB's red in ACES 2065-1 is 0.4396, 0.0898, 0.0175 */
  memcpy(image.data, (const float[]){1, 1, 1, 0.4396f, 0.0898f, 0.0175f}, 24);
  scratch_ok(pags_colour_convert(&colour, "a.exr", &image));
  const uint8_t *const to = image.data;
  assert_true(to[0] >= 254 && to[1] >= 254 && to[2] >= 254);
  assert_true(to[3] >= 253 && to[4] <= 8 && to[5] <= 8);
  pags_image_destroy(&image);
  pags_colour_set_primaries(&colour, (const double[8]){0});
  assert_int_equal(colour.kind, PAGS_COLOUR_UNKNOWN);
}

/* ---- Files ---- */

static uint8_t paint(int x, int y, int c) {
  return (uint8_t)(x * 9 + y * 7 + c * 31);
}

/* Writes a JPEG file with bytes after its first marker. */
static void write_jpeg(scratch *s, const uint8_t *more, size_t size) {
  uint8_t *plain;
  size_t plain_size;
  scratch_picture(s, "plain.jpg", 8, 8, paint);
  scratch_ok(pags_file_read(s->path, &plain, &plain_size));
  uint8_t *const all = malloc(plain_size + size);
  assert_non_null(all);
  memcpy(all, plain, 2);
  memcpy(all + 2, more, size);
  memcpy(all + 2 + size, plain + 2, plain_size - 2);
  scratch_write(s, "a.jpg", all, plain_size + size);
  free(all);
  free(plain);
}

static void test_jpeg(void **state) {
  scratch *s = *state;
  const profile whole = make_profile("RGB ", display_p3, FORMULA, 0);
  const size_t half = whole.size / 2;
  pags_image_facts facts;
  for (int missing = 0; missing < 2; missing++) { /* the second part of the profile comes first, or is missing */
    profile parts = {.size = 0};
    for (uint32_t part = 2; part > (uint32_t)missing; part--) {
      const size_t begin = part == 1 ? 0 : half, end = part == 1 ? half : whole.size;
      put(&parts, 0xffe2, 2);
      put(&parts, (uint32_t)(16 + end - begin), 2);
      put_text(&parts, "ICC_PROFILE");
      put(&parts, part, 2);
      put(&parts, 2, 1);
      memcpy(parts.bytes + parts.size, whole.bytes + begin, end - begin);
      parts.size += end - begin;
    }
    write_jpeg(s, parts.bytes, parts.size);
    scratch_ok(pags_image_inspect(s->path, &facts));
    assert_int_equal(facts.colour, missing ? PAGS_COLOUR_UNKNOWN : PAGS_COLOUR_OTHER);
    assert_string_equal(facts.space, missing ? "a damaged ICC profile" : "Named");
  }
  /* EXIF of a camera set to Adobe RGB: directory 0 at byte 8, EXIF at 26, interoperability at 44 */
  static const uint8_t exif[] = {0xff, 0xe1, 0,    70,   'E', 'x', 'i', 'f', 0, 0, 'M', 'M', 0,   42, 0, 0, 0, 8,
                                 0,    1,    0x87, 0x69, 0,   4,   0,   0,   0, 1, 0,   0,   0,   26, 0, 0, 0, 0,
                                 0,    1,    0xa0, 5,    0,   4,   0,   0,   0, 1, 0,   0,   0,   44, 0, 0, 0, 0,
                                 0,    1,    0,    1,    0,   2,   0,   0,   0, 4, 'R', '0', '3', 0,  0, 0, 0, 0};
  write_jpeg(s, exif, sizeof exif);
  scratch_ok(pags_image_inspect(s->path, &facts));
  assert_string_equal(facts.space, "Adobe RGB");
  assert_int_equal(facts.colour, PAGS_COLOUR_OTHER);
  uint8_t usual[sizeof exif];
  memcpy(usual, exif, sizeof exif);
  usual[66] = '9'; /* R98: sRGB */
  assert_false(pags_exif_says_adobe_rgb(usual + 10, sizeof usual - 10));
  for (size_t size = 0; size < sizeof exif - 10; size++)
    pags_exif_says_adobe_rgb(exif + 10, size);
}

/* The chunk iCCP follows the header of a PNG file: name, method of compression, profile. */
static void test_png(void **state) {
  scratch *s = *state;
  const profile whole = make_profile("RGB ", display_p3, FORMULA, 0);
  uint8_t packed[8192], *plain;
  uLongf size = sizeof packed;
  size_t plain_size;
  pags_image_facts facts;
  profile all = {.size = 0};
  assert_int_equal(compress(packed, &size, whole.bytes, whole.size), Z_OK);
  scratch_picture(s, "a.png", 8, 8, paint);
  scratch_ok(pags_file_read(s->path, &plain, &plain_size));
  memcpy(all.bytes, plain, 33);
  all.size = 33;
  put(&all, (uint32_t)size + 3, 4);
  put_text(&all, "iCCPx");
  put(&all, 0, 2);
  memcpy(all.bytes + all.size, packed, size);
  all.size += size;
  put(&all, (uint32_t)crc32(0, all.bytes + 37, (uInt)size + 7), 4);
  memcpy(all.bytes + all.size, plain + 33, plain_size - 33);
  scratch_write(s, "a.png", all.bytes, all.size + plain_size - 33);
  free(plain);
  scratch_ok(pags_image_inspect(s->path, &facts));
  assert_string_equal(facts.space, "Named");
  assert_int_equal(facts.colour, PAGS_COLOUR_OTHER);
  all.bytes[60] ^=
      64; /* changes the deflated bytes; the chunk's CRC or the profile's size or checksum shows the change */
  scratch_write(s, "b.png", all.bytes, all.size + plain_size - 33);
  scratch_ok(pags_image_inspect(s->path, &facts));
  assert_string_equal(facts.space, "a damaged ICC profile");
}

static void test_containers(void **state) {
  (void)state;
  const profile whole = make_profile("RGB ", display_p3, FORMULA, 0);
  pags_colour colour = {.kind = PAGS_COLOUR_SRGB};
  profile webp = {.size = 0};
  put_text(&webp, "RIFF....WEBPVP8X\n");
  put(&webp, 0, 3);
  webp.size += 10;
  put_text(&webp, "ICCP");
  put(&webp, (uint32_t)(whole.size & 255) << 24 | (uint32_t)(whole.size >> 8) << 16, 4);
  memcpy(webp.bytes + webp.size, whole.bytes, whole.size);
  webp.size += whole.size;
  assert_true(pags_container_colour(webp.bytes, webp.size, &colour));
  assert_string_equal(colour.name, "Named");
  assert_false(pags_container_colour(webp.bytes, webp.size - 1, &colour));
  profile heif = {.size = 0};
  put(&heif, 12, 4);
  put_text(&heif, "ftypheic");
  put(&heif, 12 + 8 + 8 + 19, 4);
  put_text(&heif, "meta");
  put(&heif, 0, 4);
  put(&heif, 8 + 8 + 19, 4);
  put_text(&heif, "iprp");
  put(&heif, 8 + 19, 4);
  put_text(&heif, "ipco");
  put(&heif, 19, 4);
  put_text(&heif, "colrnclx");
  put(&heif, 9 << 16 | 18, 4);
  put(&heif, 9, 2);
  put(&heif, 128, 1);
  assert_true(pags_container_colour(heif.bytes, heif.size, &colour));
  assert_string_equal(colour.name, "BT.2020, HLG (HDR)");
  for (size_t size = 0; size < heif.size; size++)
    pags_container_colour(heif.bytes, size, &colour);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_profiles),   cmocka_unit_test(test_what_is_not_converted),
      cmocka_unit_test(test_numbers),    cmocka_unit_test(test_primaries_of_light),
      scratch_test(test_jpeg),           scratch_test(test_png),
      cmocka_unit_test(test_containers),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
