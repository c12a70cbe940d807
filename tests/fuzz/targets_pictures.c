/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the decoders of pictures. Pictures of more than a million pixels, which a short file can hold, are
 * not decoded: their memory is in proportion to their pixels. */
#include "fuzz/fuzz.h"

#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "image/formats.h"
#include "picture_files.h"

enum { MOST_PIXELS = 1 << 20 };

static int run_decoder(const char *name, const uint8_t *data, size_t size,
                       pags_result (*inspect)(const pags_encoded *, pags_image_facts *, pags_colour *),
                       pags_result (*decode)(const pags_encoded *, int, pags_image *)) {
  const pags_encoded file = {.path = name, .bytes = data, .size = size};
  pags_image_facts facts;
  pags_image image;
  pags_colour colour;
  pags_result result = inspect(&file, &facts, &colour);
  if (result != PAGS_OK) {
    fuzz_refused(result, name);
    return 0;
  }
  FUZZ_CHECK(facts.width > 0 && facts.width < 65536 && facts.height > 0 && facts.height < 65536);
  FUZZ_CHECK(facts.orientation >= 1 && facts.orientation <= 8);
  if ((int64_t)facts.width * facts.height > MOST_PIXELS)
    return 0;
  for (int most = 3; most <= 4; most++) {
    result = decode(&file, most, &image);
    if (result != PAGS_OK) {
      FUZZ_CHECK(!image.data);
      fuzz_refused(result, name);
      return 0;
    }
    FUZZ_CHECK(image.width == facts.width && image.height == facts.height && image.channels >= 1 &&
               image.channels <= most);
    pags_image_destroy(&image);
  }
  return 1;
}

/* Every `step`th kind of a format. */
static void seed_kinds(picture_format format, int step) {
  char name[96];
  file_bytes bytes;
  for (int kind = 0; picture_file(format, kind, 23, 18, &bytes, name); kind++)
    if (kind % step == 0)
      fuzz_seed_bytes(bytes);
    else
      bytes_free(&bytes);
}

/* ---- PNG ---- */

static int run_png(const uint8_t *data, size_t size) {
  return run_decoder("a.png", data, size, pags_png_inspect, pags_png_decode);
}

static void seed_png(void) {
  seed_kinds(PICTURE_PNG, 2);
}

static uint32_t load_big(const uint8_t *at) {
  return (uint32_t)at[0] << 24 | (uint32_t)at[1] << 16 | (uint32_t)at[2] << 8 | at[3];
}

/* Corrects the CRCs of the chunks. */
static size_t mend_png(uint8_t *data, size_t size, size_t capacity) {
  (void)capacity;
  for (size_t at = 8; at < size && size - at >= 12;) {
    const uint32_t length = load_big(data + at);
    if (length > size - at - 12)
      break;
    const uint32_t crc = (uint32_t)crc32(0, data + at + 4, (uInt)length + 4);
    for (int i = 0; i < 4; i++)
      data[at + 8 + length + (size_t)i] = (uint8_t)(crc >> (24 - 8 * i));
    at += 12 + (size_t)length;
  }
  return size;
}

static const char *const png_words[] = {"IHDR", "PLTE", "IDAT", "IEND", "tRNS", "gAMA", "cHRM",
                                        "sBIT", "sRGB", "iCCP", "tEXt", "zTXt", "iTXt", "bKGD",
                                        "pHYs", "oFFs", "tIME", "hIST", "eXIf", "sPLT", NULL};
static const fuzz_target png = {.name = "png",
                                .seeds = seed_png,
                                .run = run_png,
                                .mend = mend_png,
                                .words = png_words,
                                .memory = 40u << 20,
                                .smoke = 20000};

/* ---- JPEG ---- */

static int run_jpeg(const uint8_t *data, size_t size) {
  return run_decoder("a.jpg", data, size, pags_jpeg_inspect, pags_jpeg_decode);
}

static void seed_jpeg(void) {
  seed_kinds(PICTURE_JPEG, 1);
}

static const char *const jpeg_words[] = {"\xff\xd8", "\xff\xd9", "\xff\xda", "\xff\xdb", "\xff\xc4", "\xff\xc2",
                                         "\xff\xc9", "\xff\xdd", "\xff\xee", "Adobe",    "JFIF",     NULL};
static const fuzz_target jpeg = {
    .name = "jpeg", .seeds = seed_jpeg, .run = run_jpeg, .words = jpeg_words, .memory = 64u << 20, .smoke = 20000};

/* ---- EXR: a block's buffers are in proportion to what the file can hold, compressed ---- */

static int run_exr(const uint8_t *data, size_t size) {
  return run_decoder("a.exr", data, size, pags_exr_inspect, pags_exr_decode);
}

static void seed_exr(void) {
  seed_kinds(PICTURE_EXR, 2);
}

static const char *const exr_words[] = {
    "channels", "chlist", "compression",      "dataWindow",         "displayWindow",     "lineOrder", "box2i",
    "float",    "v2f",    "pixelAspectRatio", "screenWindowCenter", "screenWindowWidth", "tiles",     "tiledesc",
    "type",     "string", "scanlineimage",    "deepscanline",       "chunkCount",        "int",       NULL};
static const fuzz_target exr = {.name = "exr",
                                .seeds = seed_exr,
                                .run = run_exr,
                                .words = exr_words,
                                .memory = 40u << 20,
                                .times = 4 * 1032,
                                .smoke = 20000};

const fuzz_target *const fuzz_targets[] = {&png, &jpeg, &exr, NULL};
