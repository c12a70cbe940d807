/* SPDX-License-Identifier: Apache-2.0 */
/* Tests pictures: conversion, reading and writing files, refused files, shrinking, and decoding by several threads
 * at once. */
#include <pags/image.h>
#include <pags/tasks.h>

#include "base/file.h"
#include "image/other.h"
#include "image/pixels.h"
#include "unit/scratch.h"

#include <math.h>
#include <zlib.h>

static uint8_t pattern(int x, int y, int c) {
  return (uint8_t)(x * 7 + y * 13 + c * 61);
}

static pags_image make_u8(int width, int height, int channels) {
  pags_image image;
  assert_int_equal(pags_image_create(&image, width, height, channels, PAGS_U8), PAGS_OK);
  uint8_t *out = image.data;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++)
      for (int c = 0; c < channels; c++)
        *out++ = pattern(x, y, c);
  return image;
}

static size_t samples_of(const pags_image *image) {
  return (size_t)image->width * (size_t)image->height * (size_t)image->channels;
}

static void test_create_checks_its_arguments(void **state) {
  (void)state;
  pags_image image;
  scratch_expect(pags_image_create(&image, 0, 5, 3, PAGS_U8), PAGS_ERROR_ARGUMENT, "0 x 5");
  scratch_expect(pags_image_create(&image, 5, 65536, 3, PAGS_U8), PAGS_ERROR_ARGUMENT, "65536");
  scratch_expect(pags_image_create(&image, 5, 5, 5, PAGS_U8), PAGS_ERROR_ARGUMENT, "5 channels");
  pags_image_destroy(&image); /* the failed call has set it to zeros */
  pags_image_destroy(NULL);
}

/* Every channel count written to PNG at 8 and 16 bits reads back the same, alpha included. */
static void test_png_round_trip(void **state) {
  scratch *s = *state;
  for (int channels = 1; channels <= 4; channels++) {
    pags_image image = make_u8(17, 9, channels), back;
    const char *path = scratch_path(s, "a.png");
    assert_int_equal(pags_image_save(path, &image), PAGS_OK);
    assert_int_equal(pags_image_load(path, PAGS_U8, 0, &back), PAGS_OK);
    assert_int_equal(back.channels, channels);
    assert_memory_equal(back.data, image.data, samples_of(&image));
    pags_image_destroy(&back);
    assert_int_equal(pags_image_load(path, PAGS_U16, 0, &back), PAGS_OK);
    for (size_t i = 0; i < samples_of(&image); i++)
      assert_int_equal(((uint16_t *)back.data)[i], 257 * ((uint8_t *)image.data)[i]);
    assert_int_equal(pags_image_save(path, &back), PAGS_OK); /* the file has 16 bits now */
    pags_image_destroy(&back);
    assert_int_equal(pags_image_load(path, PAGS_U8, 0, &back), PAGS_OK);
    assert_memory_equal(back.data, image.data, samples_of(&image));
    pags_image_destroy(&back);
    pags_image_destroy(&image);
  }
}

static void test_channels_are_converted(void **state) {
  scratch *s = *state;
  pags_image rgba = make_u8(5, 4, 4), out;
  const char *path = scratch_path(s, "rgba.png");
  assert_int_equal(pags_image_save(path, &rgba), PAGS_OK);
  assert_int_equal(pags_image_load(path, PAGS_U8, 3, &out), PAGS_OK);
  for (size_t i = 0; i < 20; i++) /* alpha is dropped without multiplying by it */
    assert_memory_equal((uint8_t *)out.data + 3 * i, (uint8_t *)rgba.data + 4 * i, 3);
  pags_image_destroy(&out);
  pags_image_destroy(&rgba);

  pags_image grey = make_u8(5, 4, 1);
  path = scratch_path(s, "grey.png");
  assert_int_equal(pags_image_save(path, &grey), PAGS_OK);
  assert_int_equal(pags_image_load(path, PAGS_F32, 4, &out), PAGS_OK);
  for (size_t i = 0; i < 20; i++) {
    const float *p = (const float *)out.data + 4 * i;
    assert_true(p[0] == (float)(((uint8_t *)grey.data)[i] / 255.0) && p[0] == p[1] && p[1] == p[2] && p[3] == 1);
  }
  pags_image_destroy(&out);
  pags_image_destroy(&grey);
}

static void test_float_is_rounded_and_clamped(void **state) {
  scratch *s = *state;
  pags_image image, back;
  assert_int_equal(pags_image_create(&image, 6, 1, 1, PAGS_F32), PAGS_OK);
  const float values[6] = {-1, NAN, 0.5f / 255 + 1e-4f, 127.4f / 255, 1, 7};
  const uint8_t expected[6] = {0, 0, 1, 127, 255, 255};
  memcpy(image.data, values, sizeof values);
  const char *path = scratch_path(s, "float.png");
  assert_int_equal(pags_image_save(path, &image), PAGS_OK);
  assert_int_equal(pags_image_load(path, PAGS_U8, 1, &back), PAGS_OK);
  assert_memory_equal(back.data, expected, 6);
  pags_image_destroy(&back);
  pags_image_destroy(&image);
}

static void test_exr_keeps_floats(void **state) {
  scratch *s = *state;
  enum { WIDTH = 5, HEIGHT = 3, STRIDE = 8 };
  float red[HEIGHT * STRIDE], depth[HEIGHT * STRIDE];
  for (int i = 0; i < HEIGHT * STRIDE; i++) {
    red[i] = (float)i * 1.25f - 3;
    depth[i] = 1e6f / (float)(i + 1);
  }
  const char *const names[] = {"R", "G", "B"};
  const float *const planes[] = {red, depth, red};
  const char *path = scratch_path(s, "a.exr");
  assert_int_equal(pags_image_save_exr(path, WIDTH, HEIGHT, 3, names, planes, STRIDE, NULL), PAGS_OK);
  pags_image back;
  assert_int_equal(pags_image_load(path, PAGS_F32, 0, &back), PAGS_OK);
  assert_int_equal(back.channels, 3);
  for (int y = 0; y < HEIGHT; y++)
    for (int x = 0; x < WIDTH; x++) {
      const float *p = (const float *)back.data + 3 * (y * WIDTH + x);
      assert_true(p[0] == red[y * STRIDE + x] && p[1] == depth[y * STRIDE + x] && p[2] == red[y * STRIDE + x]);
    }
  const char *const z[] = {"Z"};
  assert_int_equal(pags_image_save_exr(path, WIDTH, HEIGHT, 1, z, &planes[1], STRIDE, NULL), PAGS_OK);
  pags_image_destroy(&back);
  assert_int_equal(pags_image_load(path, PAGS_F32, 0, &back), PAGS_OK);
  assert_int_equal(back.channels, 1);
  assert_true(((float *)back.data)[WIDTH] == depth[STRIDE]);
  assert_int_equal(pags_image_save(path, &back), PAGS_OK);
  pags_image_destroy(&back);
}

static void test_jpeg(void **state) {
  scratch *s = *state;
  pags_image image, back;
  assert_int_equal(pags_image_create(&image, 64, 48, 3, PAGS_F32), PAGS_OK);
  for (size_t i = 0; i < samples_of(&image); i++)
    ((float *)image.data)[i] = 0.5f + 0.4f * sinf((float)(i / 3 % 64) * 0.1f);
  const char *path = scratch_path(s, "a.jpg");
  assert_int_equal(pags_image_save(path, &image), PAGS_OK);
  assert_int_equal(pags_image_load(path, PAGS_F32, 3, &back), PAGS_OK);
  for (size_t i = 0; i < samples_of(&image); i++)
    assert_true(fabsf(((float *)back.data)[i] - ((float *)image.data)[i]) < 0.02f);
  int width, height;
  assert_int_equal(pags_image_size(path, &width, &height), PAGS_OK);
  assert_true(width == 64 && height == 48);
  pags_image_destroy(&back);
  pags_image_destroy(&image);
}

/* Returns whether OpenImageIO is installed, which reads all formats other than PNG, JPEG and EXR. */
static bool has_oiio(void) {
  const pags_oiio *oiio;
  return pags_oiio_module(&oiio) == PAGS_OK;
}

static void test_bad_files(void **state) {
  scratch *s = *state;
  pags_image image = {0};
  const pags_result unknown = has_oiio() ? PAGS_ERROR_FORMAT : PAGS_ERROR_UNSUPPORTED;
  scratch_text(s, "four.png", "\x89PNG");
  scratch_expect(pags_image_load(scratch_path(s, "four.png"), PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "four.png");
  assert_null(image.data);
  scratch_text(s, "text.jpg", "This is not a picture.\n");
  scratch_expect(pags_image_load(scratch_path(s, "text.jpg"), PAGS_U8, 3, &image), unknown, "text.jpg");
  scratch_text(s, "empty.png", "");
  scratch_expect(pags_image_load(scratch_path(s, "empty.png"), PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "empty.png");
  scratch_expect(pags_image_load(s->folder, PAGS_U8, 3, &image), PAGS_ERROR_IO, "folder");
  scratch_expect(pags_image_load(scratch_path(s, "none.png"), PAGS_U8, 3, &image), PAGS_ERROR_IO, "none.png");
  int width, height;
  scratch_expect(pags_image_size(scratch_path(s, "text.jpg"), &width, &height), unknown, "text.jpg");
}

/* Without OpenImageIO the refusal names the supported formats and the kind of the file; with it the file is read. */
static void test_other_formats(void **state) {
  scratch *s = *state;
  pags_image image;
  scratch_text(s, "a.ppm", "P6\n1 1\n255\nabc");
  if (has_oiio()) {
    assert_int_equal(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_OK);
    assert_memory_equal(image.data, "abc", 3);
    pags_image_destroy(&image);
    return;
  }
  scratch_expect(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_ERROR_UNSUPPORTED,
                 "a.ppm: PNG, JPEG and EXR are read; this file is a PPM; OpenImageIO reads more: ");
  assert_null(image.data);
}

/* The decoder is chosen by a file's contents, not by its name. */
static void test_names_mislead(void **state) {
  scratch *s = *state;
  static const char *const names[] = {"a.png", "a.jpg", "a.exr"};
  for (int i = 0; i < 3; i++) {
    uint8_t *bytes;
    size_t size;
    int width, height;
    scratch_picture(s, names[i], 12, 9, pattern);
    assert_int_equal(pags_file_read(s->path, &bytes, &size), PAGS_OK);
    scratch_write(s, names[(i + 1) % 3], bytes, size);
    free(bytes);
    assert_int_equal(pags_image_size(s->path, &width, &height), PAGS_OK);
    assert_true(width == 12 && height == 9);
  }
}

/* Returns column and row in the file of the pixel (x, y) of the upright picture, by EXIF's definitions ("the 0th row
 * is the visual right-hand side", ...). Width and height are those of the file. */
static void stored_place(int orientation, int width, int height, int x, int y, int *column, int *row) {
  const int places[9][2] = {{0},
                            {x, y},
                            {width - 1 - x, y},
                            {width - 1 - x, height - 1 - y},
                            {x, height - 1 - y},
                            {y, x},
                            {y, height - 1 - x},
                            {width - 1 - y, height - 1 - x},
                            {width - 1 - y, x}};
  *column = places[orientation][0];
  *row = places[orientation][1];
}

static void test_turning(void **state) {
  (void)state;
  for (int orientation = 1; orientation <= 8; orientation++) {
    pags_image image = make_u8(5, 3, 2);
    scratch_ok(pags_image_turn(&image, orientation));
    assert_int_equal(image.width, orientation >= 5 ? 3 : 5);
    assert_int_equal(image.height, orientation >= 5 ? 5 : 3);
    for (int y = 0; y < image.height; y++)
      for (int x = 0; x < image.width; x++) {
        int column, row;
        stored_place(orientation, 5, 3, x, y, &column, &row);
        for (int c = 0; c < 2; c++)
          assert_int_equal(((const uint8_t *)image.data)[(y * image.width + x) * 2 + c], pattern(column, row, c));
      }
    pags_image_destroy(&image);
  }
}

/* A JPEG file whose EXIF segment has one entry, in both byte orders; invalid entries count as no orientation. */
static void test_orientation_of_jpeg(void **state) {
  scratch *s = *state;
  pags_image image = make_u8(16, 8, 3);
  const char *path = scratch_path(s, "a.jpg");
  scratch_ok(pags_image_save(path, &image));
  pags_image_destroy(&image);
  size_t size;
  uint8_t *plain;
  scratch_ok(pags_file_read(path, &plain, &size));
  for (int kind = 0; kind < 4; kind++) {
    uint8_t exif[36] = {0xff, 0xe1, 0, 34, 'E', 'x', 'i', 'f', 0, 0};
    const uint8_t little[26] = {'I', 'I', 42, 0, 8, 0, 0, 0, 1, 0, 0x12, 1, 3, 0, 1, 0, 0, 0, 6, 0};
    const uint8_t big[26] = {'M', 'M', 0, 42, 0, 0, 0, 8, 0, 1, 1, 0x12, 0, 3, 0, 0, 0, 1, 0, 8};
    memcpy(exif + 10, kind == 1 ? big : little, 26);
    exif[28] = kind == 2 ? 9 : exif[28];    /* 9 is no orientation */
    exif[14] = kind == 3 ? 0xff : exif[14]; /* the directory lies outside of the segment */
    uint8_t *turned = malloc(size + sizeof exif);
    memcpy(turned, plain, 2);
    memcpy(turned + 2, exif, sizeof exif);
    memcpy(turned + 2 + sizeof exif, plain + 2, size - 2);
    scratch_write(s, "b.jpg", turned, size + sizeof exif);
    free(turned);
    pags_image_facts facts;
    scratch_ok(pags_image_inspect(scratch_path(s, "b.jpg"), &facts));
    assert_int_equal(facts.orientation, kind == 0 ? 6 : kind == 1 ? 8 : 1);
    assert_true(facts.width == 16 && facts.height == 8 && facts.sample == PAGS_U8 && !facts.alpha);
  }
  free(plain);
}

/* The size of a JPEG is found behind three EXIF segments of 65 kB, more than is read at first. */
static void test_size_after_a_long_header(void **state) {
  scratch *s = *state;
  enum { LENGTH = 65535 };
  static const uint8_t head[4] = {0xff, 0xe1, LENGTH >> 8, LENGTH & 255};
  uint8_t *bytes, *longer;
  size_t size;
  int width, height;
  scratch_picture(s, "long.jpg", 40, 30, pattern);
  assert_int_equal(pags_file_read(s->path, &bytes, &size), PAGS_OK);
  longer = calloc(1, size + 3 * (LENGTH + 2));
  assert_non_null(longer);
  memcpy(longer, bytes, 2);
  for (size_t i = 0; i < 3; i++)
    memcpy(longer + 2 + i * (LENGTH + 2), head, 4);
  memcpy(longer + 2 + 3 * (LENGTH + 2), bytes + 2, size - 2);
  scratch_write(s, "long.jpg", longer, size + 3 * (LENGTH + 2));
  free(longer);
  free(bytes);
  assert_int_equal(pags_image_size(s->path, &width, &height), PAGS_OK);
  assert_true(width == 40 && height == 30);
}

/* A header that claims more pixels than its file can hold is refused before memory for them is allocated. */
static void test_sizes_that_a_file_can_not_hold(void **state) {
  scratch *s = *state;
  static const struct {
    const char *name;
    size_t width, height; /* two bytes of each lie at this place of the file */
  } files[] = {{"claims.png", 18, 22}, {"claims.jpg", 0, 0}};
  for (int i = 0; i < 2; i++) {
    uint8_t *bytes;
    size_t size, width = files[i].width, height = files[i].height;
    pags_image image = {0};
    scratch_picture(s, files[i].name, 12, 9, pattern);
    assert_int_equal(pags_file_read(s->path, &bytes, &size), PAGS_OK);
    for (size_t at = 0; width == 0 && at + 9 < size; at++)
      if (bytes[at] == 0xff && bytes[at + 1] == 0xc0) { /* start of frame: length, precision, height, width */
        height = at + 5;
        width = at + 7;
      }
    for (size_t k = 0; k < 2; k++)
      bytes[width + k] = bytes[height + k] = 0xf0;
    if (i == 0) { /* corrects the header's CRC, which follows its 17 bytes */
      const uint32_t crc = (uint32_t)crc32(0, bytes + 12, 17);
      for (int k = 0; k < 4; k++)
        bytes[29 + k] = (uint8_t)(crc >> (24 - 8 * k));
    }
    scratch_write(s, files[i].name, bytes, size);
    free(bytes);
    scratch_expect(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "too few for 61680 x 61680 pixels");
    assert_null(image.data);
  }
}

/* Cuts a file that decodes to `keep` thousandths of its size and expects a refusal. */
static void expect_cut(scratch *s, const char *name, size_t keep) {
  uint8_t *bytes;
  size_t size;
  pags_image image = {0};
  assert_int_equal(pags_file_read(scratch_path(s, name), &bytes, &size), PAGS_OK);
  scratch_write(s, name, bytes, size * keep / 1000);
  free(bytes);
  scratch_expect(pags_image_load(scratch_path(s, name), PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, name);
  assert_null(image.data);
}

static void test_cut_off_files(void **state) {
  scratch *s = *state;
  const char *const names[] = {"cut.png", "cut.jpg", "cut.exr"};
  for (int i = 0; i < 3; i++)
    for (size_t keep = 190; keep < 1000; keep += 400) {
      scratch_picture(s, names[i], 120, 90, pattern);
      expect_cut(s, names[i], keep);
    }
}

static void put32(uint8_t *to, uint32_t value) {
  for (int k = 0; k < 4; k++)
    to[k] = (uint8_t)(value >> (8 * k));
}

/* Writes a TIFF of 12 x 8 byte pixels in one strip after the directory, stored or compressed by Deflate. Returns its
 * size. */
static size_t make_tiff(bool deflate, uint8_t *out) {
  enum {
    WIDTH = 12,
    HEIGHT = 8,
    BYTES = WIDTH * HEIGHT * 3,
    FIELDS = 10,
    BITS = 10 + 12 * FIELDS + 4,
    PIXELS = BITS + 6
  };
  uint8_t pixels[BYTES];
  uLongf size = 512;
  for (int i = 0; i < BYTES; i++)
    pixels[i] = (uint8_t)(1 + (i * i + 7 * i) % 251);
  memset(out, 0, PIXELS);
  if (deflate)
    assert_int_equal(compress(out + PIXELS, &size, pixels, BYTES), Z_OK);
  else
    memcpy(out + PIXELS, pixels, size = BYTES);
  const uint32_t fields[FIELDS][4] = {
      {256, 3, 1, WIDTH},  {257, 3, 1, HEIGHT}, {258, 3, 3, BITS},   {259, 3, 1, deflate ? 8 : 1}, {262, 3, 1, 2},
      {273, 4, 1, PIXELS}, {277, 3, 1, 3},      {278, 3, 1, HEIGHT}, {279, 4, 1, (uint32_t)size},  {284, 3, 1, 1}};
  memcpy(out, "II*\0\x8\0\0\0\xa", 9);
  for (int i = 0, at = 10; i < FIELDS; i++, at += 12) {
    put32(out + at, fields[i][0] | fields[i][1] << 16);
    put32(out + at + 4, fields[i][2]);
    put32(out + at + 8, fields[i][3]);
  }
  for (int k = 0; k < 3; k++)
    out[BITS + 2 * k] = 8;
  return PIXELS + size;
}

/* A TIFF that OpenImageIO reads is refused wherever it is cut. A compressed one is also refused if its data are
 * replaced by zeros. */
static void test_cut_off_files_of_other_formats(void **state) {
  scratch *s = *state;
  pags_image image = {0};
  for (int deflate = 0; deflate < 2 && has_oiio(); deflate++) {
    uint8_t file[1024];
    const size_t size = make_tiff(deflate, file);
    scratch_write(s, "a.tif", file, size);
    assert_int_equal(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_OK);
    assert_int_equal(((uint8_t *)image.data)[287], 1 + (287 * 287 + 7 * 287) % 251);
    pags_image_destroy(&image);
    for (size_t keep = 1; keep < size; keep += 7) {
      scratch_write(s, "a.tif", file, keep);
      scratch_expect(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "a.tif");
    }
    for (size_t at = size - 200; deflate && at < size - 20; at += 20) {
      uint8_t damaged[1024];
      memcpy(damaged, file, size);
      memset(damaged + at, 0, 20);
      scratch_write(s, "a.tif", damaged, size);
      scratch_expect(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "damaged");
    }
  }
  const char *const never[] = {"\0\0\1\0\1\0", "FOR4\0\0"}; /* OpenImageIO's readers of these formats crash */
  for (int i = 0; i < 2; i++) {
    scratch_write(s, "a.png", never[i], 6);
    scratch_expect(pags_image_load(s->path, PAGS_U8, 3, &image), PAGS_ERROR_FORMAT, "which isn't read");
  }
}

/* A PNG chunk between header (33 bytes) and pixels that claims more bytes than the file has is refused; libpng would
 * allocate them before it notices. */
static void test_png_that_claims_too_much(void **state) {
  scratch *s = *state;
  static const uint8_t chunk[] = {0x46, 0x46, 0x49, 0x2a, 'e', 'X', 'I', 'f', 'I', 'I', 0x2a, 0};
  uint8_t *bytes;
  size_t size;
  pags_image image = {0};
  scratch_picture(s, "claims.png", 12, 9, pattern);
  assert_int_equal(pags_file_read(scratch_path(s, "claims.png"), &bytes, &size), PAGS_OK);
  uint8_t *const longer = malloc(size + sizeof chunk);
  assert_non_null(longer);
  memcpy(longer, bytes, 33);
  memcpy(longer + 33, chunk, sizeof chunk);
  memcpy(longer + 33 + sizeof chunk, bytes + 33, size - 33);
  scratch_write(s, "claims.png", longer, size + sizeof chunk);
  free(longer);
  free(bytes);
  scratch_expect(pags_image_load(scratch_path(s, "claims.png"), PAGS_U8, 3, &image), PAGS_ERROR_FORMAT,
                 "claims.png: not a readable picture: the chunk at byte 33 is to hold 1179011370 bytes");
}

static void test_saving_fails_cleanly(void **state) {
  scratch *s = *state;
  pags_image image = make_u8(4, 4, 3);
  scratch_expect(pags_image_save(scratch_path(s, "none/a.png"), &image), PAGS_ERROR_IO, "none/a.png");
  scratch_expect(pags_image_save(scratch_path(s, "a.what"), &image), PAGS_ERROR_ARGUMENT, "a.what");
  scratch_text(s, "dir.png/file", "x");
  scratch_expect(pags_image_save(scratch_path(s, "dir.png"), &image), PAGS_ERROR_IO, "dir.png");
  pags_dir_list list;
  assert_int_equal(pags_dir_list_read(s->folder, &list), PAGS_OK);
  for (int64_t i = 0; i < list.count; i++)
    assert_null(strstr(list.names[i], "part")); /* no temporary file is left */
  pags_dir_list_destroy(&list);
  pags_image_destroy(&image);
}

/* The temporary file of a killed process is overwritten and then renamed, so that it doesn't remain. */
static void test_saving_clears_up(void **state) {
  scratch *s = *state;
  scratch_text(s, "again.png.part", "half of a picture");
  scratch_picture(s, "again.png", 4, 3, pattern);
  assert_true(pags_file_exists(scratch_path(s, "again.png")));
  assert_false(pags_file_exists(scratch_path(s, "again.png.part")));
}

/* Saving the same pixels twice gives the same bytes: the file holds no date and no host name. */
static void test_saving_is_deterministic(void **state) {
  scratch *s = *state;
  const char *const names[] = {"x.png", "x.jpg", "x.exr"};
  for (int i = 0; i < 3; i++) {
    uint8_t *first, *second;
    size_t first_size, second_size;
    scratch_picture(s, names[i], 31, 17, pattern);
    assert_int_equal(pags_file_read(s->path, &first, &first_size), PAGS_OK);
    scratch_picture(s, names[i], 31, 17, pattern);
    assert_int_equal(pags_file_read(s->path, &second, &second_size), PAGS_OK);
    assert_int_equal(first_size, second_size);
    assert_memory_equal(first, second, first_size);
    free(first);
    free(second);
  }
}

static void test_shrink_mean(void **state) {
  (void)state;
  pags_image from = make_u8(12, 10, 3), to;
  const uint8_t *in = from.data;
  assert_int_equal(pags_image_create(&to, 6, 5, 3, PAGS_U8), PAGS_OK);
  assert_int_equal(pags_shrink_mean(&from, 2, 2, &to), PAGS_OK);
  for (int y = 0; y < 5; y++)
    for (int x = 0; x < 6; x++)
      for (int c = 0; c < 3; c++) {
        int sum = 0;
        for (int i = 0; i < 4; i++)
          sum += in[((2 * y + i / 2) * 12 + 2 * x + i % 2) * 3 + c];
        assert_int_equal(((uint8_t *)to.data)[(y * 6 + x) * 3 + c], (sum + 2) / 4);
      }
  pags_image_destroy(&to);

  /* The mean of a ramp over [1.5 x, 1.5 (x + 1)) is its value in the middle: 10 (1.5 x + 0.25) for a ramp of 10 i at
   * pixel i. */
  for (int i = 0; i < 12 * 10 * 3; i++)
    ((uint8_t *)from.data)[i] = (uint8_t)(10 * (i / 3 % 12));
  assert_int_equal(pags_image_create(&to, 8, 6, 3, PAGS_U8), PAGS_OK);
  assert_int_equal(pags_shrink_mean(&from, 1.5, 1.5, &to), PAGS_OK);
  const uint8_t expected[8] = {3, 17, 33, 47, 63, 77, 93, 107};
  for (int x = 0; x < 8; x++)
    assert_int_equal(((uint8_t *)to.data)[(3 * 8 + x) * 3], expected[x]);
  pags_image_destroy(&to);
  pags_image_destroy(&from);
}

static void test_shrink_mask(void **state) {
  (void)state;
  pags_image from, to;
  assert_int_equal(pags_image_create(&from, 9, 6, 1, PAGS_U8), PAGS_OK);
  memset(from.data, 200, 54);
  ((uint8_t *)from.data)[2 * 9 + 4] = 127; /* below one half: the pixel is masked */
  assert_int_equal(pags_image_create(&to, 3, 2, 1, PAGS_U8), PAGS_OK);
  pags_shrink_mask(&from, 3, 3, &to);
  const uint8_t expected[6] = {255, 0, 255, 255, 255, 255};
  assert_memory_equal(to.data, expected, 6);
  pags_image_destroy(&to);
  pags_image_destroy(&from);
}

typedef struct load_context {
  const char *paths[2];
  uint8_t first[2][3];
  int failures[64];
} load_context;

static void load_block(void *user, int64_t begin, int64_t end, int worker) {
  load_context *context = user;
  for (int64_t i = begin; i < end; i++) {
    pags_image image;
    if (pags_image_load(context->paths[i % 2], PAGS_U8, 3, &image) != PAGS_OK ||
        memcmp(image.data, context->first[i % 2], 3) != 0)
      context->failures[worker]++;
    pags_image_destroy(&image);
  }
}

typedef struct race {
  const char *path;
  pags_result results[8];
} race;

/* The first image call of the process: the threads race to load the OpenImageIO module. */
static void race_block(void *user, int64_t begin, int64_t end, int worker) {
  (void)end, (void)worker;
  race *r = user;
  int width, height;
  r->results[begin] = pags_image_size(r->path, &width, &height);
}

static void test_threads(void **state) {
  scratch *s = *state;
  char other[256];
  scratch_text(s, "race.ppm", "P6\n1 1\n255\nabc");
  race racing = {.path = s->path};
  pags_tasks *tasks = pags_tasks_create(4);
  assert_true(pags_parallel_for(tasks, 8, 1, race_block, &racing));
  for (int i = 0; i < 8; i++)
    assert_int_equal(racing.results[i], has_oiio() ? PAGS_OK : PAGS_ERROR_UNSUPPORTED);
  scratch_picture(s, "t.png", 50, 40, pattern);
  snprintf(other, sizeof other, "%s", s->path);
  scratch_picture(s, "t.exr", 50, 40, pattern);
  load_context context = {.paths = {other, s->path}, .first = {{0, 61, 122}, {0, 61, 122}}};
  assert_true(pags_parallel_for(tasks, 64, 1, load_block, &context));
  for (int i = 0; i < 64; i++)
    assert_int_equal(context.failures[i], 0);
  pags_tasks_destroy(tasks);
}

int main(void) {
  const struct CMUnitTest tests[] = {
      cmocka_unit_test(test_create_checks_its_arguments),
      scratch_test(test_threads), /* must be first: see race_block */
      scratch_test(test_png_round_trip),
      scratch_test(test_channels_are_converted),
      scratch_test(test_float_is_rounded_and_clamped),
      scratch_test(test_exr_keeps_floats),
      scratch_test(test_jpeg),
      scratch_test(test_bad_files),
      scratch_test(test_other_formats),
      scratch_test(test_names_mislead),
      scratch_test(test_size_after_a_long_header),
      scratch_test(test_sizes_that_a_file_can_not_hold),
      scratch_test(test_cut_off_files),
      scratch_test(test_cut_off_files_of_other_formats),
      scratch_test(test_png_that_claims_too_much),
      scratch_test(test_saving_fails_cleanly),
      scratch_test(test_saving_clears_up),
      scratch_test(test_saving_is_deterministic),
      cmocka_unit_test(test_turning),
      scratch_test(test_orientation_of_jpeg),
      cmocka_unit_test(test_shrink_mean),
      cmocka_unit_test(test_shrink_mask),
  };
  return cmocka_run_group_tests(tests, NULL, NULL);
}
