/* SPDX-License-Identifier: Apache-2.0 */
/* Fuzz targets of the windows and channels of EXR files and of pictures' colour spaces. The first target writes a
 * file with the windows and channels that its input describes and with known samples, so that every pixel can be
 * checked. */
#include "fuzz/fuzz.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "image/colour.h"
#include "image/formats.h"
#include "image/layers.h"
#include "image/other.h"

/* ---- Windows ---- */

/* A file, as the input describes it. */
typedef struct window_file {
  pags_window_box data, shown;
  int channels; /* 1: Y, 3: RGB, 4: RGBA */
  bool parts;   /* the depth is in a separate part before the colours */
  bool layer;   /* the colours belong to one of two layers */
} window_file;

enum { DESCRIPTION = 12 };

static window_file read_description(const uint8_t bytes[DESCRIPTION]) {
  static const int32_t places[] = {0, 0, 1000, -70000, INT32_MAX - 700, INT32_MIN + 700};
  const int64_t x = places[bytes[9] % 6], y = places[bytes[10] % 6];
  const int64_t left = x + (int8_t)bytes[0], top = y + (int8_t)bytes[1];
  const int64_t shown_left = x + (int8_t)bytes[4], shown_top = y + (int8_t)bytes[5];
  static const int channels[] = {3, 4, 1};
  return (window_file){
      .data = {left, top, left + bytes[2] % 48 + 1, top + bytes[3] % 48 + 1},
      .shown = {shown_left, shown_top, shown_left + bytes[6] % 96 + 1, shown_top + bytes[7] % 96 + 1},
      .channels = channels[bytes[8] % 3],
      .parts = bytes[8] & 64,
      .layer = bytes[8] & 128,
  };
}

static void put_attribute(file_bytes *out, const char *name, const char *type, size_t size) {
  bytes_put(out, name, strlen(name) + 1);
  bytes_put(out, type, strlen(type) + 1);
  bytes_u32(out, (uint32_t)size);
}

static void put_window(file_bytes *out, const char *name, const pags_window_box *box) {
  put_attribute(out, name, "box2i", 16);
  bytes_u32(out, (uint32_t)box->left);
  bytes_u32(out, (uint32_t)box->top);
  bytes_u32(out, (uint32_t)(box->right - 1));
  bytes_u32(out, (uint32_t)(box->bottom - 1));
}

/* Writes the header of a part with channels of these names, in alphabetical order. */
static void put_header(file_bytes *out, const window_file *file, const char *part, const char *const *names,
                       int count) {
  size_t size = 1;
  for (int c = 0; c < count; c++)
    size += strlen(names[c]) + 17;
  put_attribute(out, "channels", "chlist", size);
  for (int c = 0; c < count; c++) {
    bytes_put(out, names[c], strlen(names[c]) + 1);
    bytes_u32(out, 2); /* float */
    bytes_u32(out, 0);
    bytes_u32(out, 1);
    bytes_u32(out, 1);
  }
  bytes_u8(out, 0);
  put_attribute(out, "compression", "compression", 1);
  bytes_u8(out, 0);
  put_window(out, "dataWindow", &file->data);
  put_window(out, "displayWindow", &file->shown);
  put_attribute(out, "lineOrder", "lineOrder", 1);
  bytes_u8(out, 0);
  put_attribute(out, "pixelAspectRatio", "float", 4);
  bytes_f32(out, 1);
  put_attribute(out, "screenWindowCenter", "v2f", 8);
  bytes_f32(out, 0);
  bytes_f32(out, 0);
  put_attribute(out, "screenWindowWidth", "float", 4);
  bytes_f32(out, 1);
  if (file->parts) {
    put_attribute(out, "name", "string", strlen(part));
    bytes_put(out, part, strlen(part));
    put_attribute(out, "type", "string", 13);
    bytes_put(out, "scanlineimage", 13);
    put_attribute(out, "chunkCount", "int", 4);
    bytes_u32(out, (uint32_t)(file->data.bottom - file->data.top));
  }
  bytes_u8(out, 0);
}

/* The sample of the picture's channel c (red, green, blue, alpha) at a place. */
static float sample_at(int64_t x, int64_t y, int c) {
  const uint32_t mixed = (uint32_t)x * 2654435761u ^ (uint32_t)y * 2246822519u ^ (uint32_t)c * 3266489917u;
  return (float)(mixed >> 8) * 0x1p-20f - 3;
}

/* The channels in a part, and the picture's channel that each holds; -1: none. */
typedef struct channel_set {
  const char *names[8];
  int of[8];
  int count;
} channel_set;

static channel_set colours_of(const window_file *file) {
  static const channel_set sets[] = {
      {{"B", "G", "R"}, {2, 1, 0}, 3},
      {{"A", "B", "G", "R", "Z"}, {3, 2, 1, 0, -1}, 5},
      {{"Y"}, {0}, 1},
      {{"V.AO.B", "V.AO.G", "V.AO.R", "V.Combined.B", "V.Combined.G", "V.Combined.R"}, {-1, -1, -1, 2, 1, 0}, 6},
      {{"V.AO.Y", "V.Combined.A", "V.Combined.B", "V.Combined.G", "V.Combined.R"}, {-1, 3, 2, 1, 0}, 5},
      {{"V.AO.Z", "V.Combined.Y"}, {-1, 0}, 2}};
  return sets[(file->channels == 3 ? 0 : file->channels == 4 ? 1 : 2) + (file->layer ? 3 : 0)];
}

static void put_lines(file_bytes *out, const window_file *file, uint64_t *place, uint32_t part, const channel_set *set,
                      bool table) {
  const int64_t width = file->data.right - file->data.left;
  const size_t line = (size_t)width * 4 * (size_t)set->count;
  for (int64_t y = file->data.top; y < file->data.bottom; y++) {
    if (table) {
      bytes_u64(out, *place);
      *place += line + 8 + (file->parts ? 4 : 0);
      continue;
    }
    if (file->parts)
      bytes_u32(out, part);
    bytes_u32(out, (uint32_t)y);
    bytes_u32(out, (uint32_t)line);
    for (int c = 0; c < set->count; c++)
      for (int64_t x = file->data.left; x < file->data.right; x++)
        bytes_f32(out, set->of[c] < 0 ? 77 : sample_at(x, y, set->of[c]));
  }
}

static file_bytes make_file(const window_file *file) {
  static const channel_set depth = {{"Z"}, {-1}, 1};
  const channel_set colours = colours_of(file);
  const int64_t rows = file->data.bottom - file->data.top;
  file_bytes out = {0};
  bytes_u32(&out, 20000630);
  bytes_u32(&out, file->parts ? 0x1002 : 2);
  if (file->parts)
    put_header(&out, file, "depth", depth.names, depth.count);
  put_header(&out, file, "rgba", colours.names, colours.count);
  if (file->parts)
    bytes_u8(&out, 0);
  uint64_t place = out.size + 8 * (uint64_t)rows * (file->parts ? 2 : 1);
  if (file->parts)
    put_lines(&out, file, &place, 0, &depth, true);
  put_lines(&out, file, &place, 1, &colours, true);
  if (file->parts)
    put_lines(&out, file, &place, 0, &depth, false);
  put_lines(&out, file, &place, 1, &colours, false);
  return out;
}

static void check_pixels(const window_file *file, const pags_image *image) {
  const float *p = image->data;
  for (int64_t y = file->shown.top; y < file->shown.bottom; y++)
    for (int64_t x = file->shown.left; x < file->shown.right; x++, p += image->channels) {
      const bool inside = x >= file->data.left && x < file->data.right && y >= file->data.top && y < file->data.bottom;
      for (int c = 0; c < image->channels; c++) {
        const float expected = !inside ? 0 : c < file->channels ? sample_at(x, y, c) : 1;
        FUZZ_CHECK(memcmp(&p[c], &expected, sizeof expected) == 0);
      }
    }
}

static int run_windows(const uint8_t *data, size_t size) {
  uint8_t description[DESCRIPTION] = {0};
  memcpy(description, data, size < DESCRIPTION ? size : DESCRIPTION);
  const window_file file = read_description(description);
  file_bytes bytes = make_file(&file);
  const pags_encoded encoded = {.path = "a.exr", .bytes = bytes.data, .size = bytes.size};
  pags_image_facts facts;
  pags_colour colour;
  const bool apart = file.data.right <= file.shown.left || file.shown.right <= file.data.left ||
                     file.data.bottom <= file.shown.top || file.shown.bottom <= file.data.top;
  const pags_result result = pags_exr_inspect(&encoded, &facts, &colour);
  /* OpenEXRCore itself refuses windows near the ends of 32 bits. */
  FUZZ_CHECK(result == PAGS_OK || apart || description[9] % 6 > 3 || description[10] % 6 > 3);
  if (result != PAGS_OK) {
    fuzz_refused(result, "a.exr");
    bytes_free(&bytes);
    return 0;
  }
  FUZZ_CHECK(!apart && facts.width == file.shown.right - file.shown.left &&
             facts.height == file.shown.bottom - file.shown.top && facts.alpha == (file.channels == 4));
  for (int most = 3; most <= 4; most++) {
    pags_image image;
    FUZZ_CHECK(pags_exr_decode(&encoded, most, &image) == PAGS_OK);
    FUZZ_CHECK(image.width == facts.width && image.height == facts.height && image.channels <= most);
    check_pixels(&file, &image);
    pags_image_destroy(&image);
  }
  bytes_free(&bytes);
  return 1;
}

static void seed_windows(void) {
  static const uint8_t seeds[][DESCRIPTION] = {{0, 0, 31, 23, 0, 0, 31, 23},
                                               {10, 5, 15, 12, 0, 0, 47, 39, 1},
                                               {0xf8, 0xfa, 47, 40, 0, 0, 31, 23, 2, 2, 3},
                                               {0xf0, 3, 31, 23, 0, 0, 31, 23, 64 + 128, 1, 1},
                                               {5, 0xfd, 31, 23, 0, 0, 31, 23, 128 + 1, 3, 2},
                                               {5, 2, 31, 23, 0, 0, 31, 23, 64 + 2, 0, 0}};
  for (size_t i = 0; i < sizeof seeds / sizeof *seeds; i++)
    fuzz_seed(seeds[i], DESCRIPTION);
}

static const fuzz_target windows = {
    .name = "exr_windows", .seeds = seed_windows, .run = run_windows, .memory = 4u << 20, .smoke = 3000};

/* ---- Layers: names of channels, one a line; a line that begins with | begins a part of that name ---- */

enum { MOST_CHANNELS = 64 };

static int run_layers(const uint8_t *data, size_t size) {
  char *const text = malloc(size + 1);
  FUZZ_CHECK(text);
  memcpy(text, data, size);
  text[size] = '\0';
  pags_layer_channel channels[MOST_CHANNELS] = {{0}};
  const char *part = "";
  int count = 0, index = 0, part_index = -1;
  for (char *at = text, *end; at < text + size && count < MOST_CHANNELS; at = end + 1) {
    end = at + strcspn(at, "\n");
    *end = '\0';
    const bool number = *at == '#';
    if (*at == '|') {
      part = at + 1;
      part_index += part_index < 0 && count > 0 ? 2 : 1; /* the channels before are a part as well */
      index = 0;
    } else if (at[number]) {
      channels[count++] = (pags_layer_channel){at + number, part, part_index > 0 ? part_index : 0, index++, number};
    }
  }
  pags_layer layer;
  const pags_result result = pags_layer_choose("a.exr", channels, count, &layer);
  if (result == PAGS_OK) {
    FUZZ_CHECK(count > 0 && layer.channels >= 1 && layer.channels <= 4);
    FUZZ_CHECK(layer.alpha == (layer.channels == 2 || layer.channels == 4));
    FUZZ_CHECK(strlen(layer.name) < sizeof layer.name);
    for (int i = 0; i < layer.channels; i++) {
      bool there = false;
      for (int c = 0; c < count; c++)
        there = there ||
                (channels[c].part_index == layer.part && channels[c].index == layer.order[i] && !channels[c].number);
      FUZZ_CHECK(there);
      for (int k = 0; k < i; k++)
        FUZZ_CHECK(layer.order[k] != layer.order[i]);
    }
  } else {
    fuzz_refused(result, "a.exr");
  }
  free(text);
  return result == PAGS_OK;
}

static void seed_layers(void) {
  fuzz_seed_text("A\nB\nG\nR\nZ\n#id");
  fuzz_seed_text("V.AO.B\nV.AO.G\nV.AO.R\nV.Combined.A\nV.Combined.B\nV.Combined.G\nV.Combined.R\nV.Depth.Z");
  fuzz_seed_text("|depth\nZ\n|rgba\nA\nB\nG\nR");
  fuzz_seed_text("|left\nB\nG\nR\n|right\nB\nG\nR");
  fuzz_seed_text("albedo.Red\nalbedo.Green\nalbedo.Blue\nbeauty.Red\nbeauty.Green\nbeauty.Blue\nbeauty.Alpha");
  fuzz_seed_text("Y");
}

static const char *const layer_words[] = {"Combined", "Composite", "rgba", "beauty", "Red", "Green", "Blue", "Alpha",
                                          "RY",       "BY",        ".",    "\n",     "|",   "#",     NULL};
static const fuzz_target layers = {.name = "exr_layers", .seeds = seed_layers, .run = run_layers, .words = layer_words};

/* ---- Colour spaces: an ICC profile, or the beginning of a container ---- */

static void check_colour(const pags_colour *colour) {
  FUZZ_CHECK(strlen(colour->name) < sizeof colour->name);
  if (colour->kind != PAGS_COLOUR_OTHER)
    return;
  pags_image image;
  FUZZ_CHECK(pags_image_create(&image, 3, 2, 3, PAGS_F32) == PAGS_OK);
  const float values[18] = {0, 1, 0.5f, -7, 9, NAN, INFINITY, 1e30f, -1e30f, 0.01f, 0.99f, 0.2f};
  memcpy(image.data, values, sizeof values);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i <= PAGS_CURVE_STEPS; i++)
      FUZZ_CHECK(isfinite(colour->light[c][i]));
  for (int i = 0; i < 9; i++)
    FUZZ_CHECK(isfinite(colour->matrix[i]));
  FUZZ_CHECK(pags_colour_convert(colour, "a.png", &image) == PAGS_OK && image.sample == PAGS_U8);
  pags_image_destroy(&image);
}

static int run_colours(const uint8_t *data, size_t size) {
  pags_colour colour = {.kind = PAGS_COLOUR_SRGB};
  const bool found = pags_container_colour(data, size, &colour);
  check_colour(&colour);
  pags_colour_set_icc(&colour, data, size);
  check_colour(&colour);
  const bool known = colour.kind != PAGS_COLOUR_UNKNOWN;
  if (size >= 32) {
    double xy[8];
    for (int i = 0; i < 8; i++) {
      int32_t fixed;
      memcpy(&fixed, data + 4 * i, 4);
      xy[i] = fixed / 65536.0;
    }
    pags_colour_set_primaries(&colour, xy);
    check_colour(&colour);
    pags_colour_set_gamma(&colour, fabs(xy[7]), xy, NULL);
    check_colour(&colour);
    pags_colour_set_cicp(&colour, data[0], data[1], data[2] & 1);
    check_colour(&colour);
  }
  return found || known;
}

/* Makes an ICC profile with a matrix and one curve for all channels. */
static file_bytes make_profile(bool formula) {
  static const char *const tags[] = {"rXYZ", "gXYZ", "bXYZ", "rTRC", "gTRC", "bTRC"};
  static const int32_t columns[9] = {33759, 15807, -69, 19135, 45368, 2745, 10296, 4363, 51385};
  static const int32_t numbers[] = {157286, 62119, 3417, 5072, 2651};
  uint8_t head[128] = {0};
  file_bytes out = {0};
  memcpy(head + 16, "RGB XYZ ", 8);
  memcpy(head + 36, "acsp", 4);
  bytes_put(&out, head, sizeof head);
  const size_t first = 132 + 6 * 12, curve = first + 60, curve_size = formula ? 32 : 14;
#define PUT_BIG(value)                         \
  for (int shift = 24; shift >= 0; shift -= 8) \
  bytes_u8(&out, (uint32_t)(value) >> shift & 255)
  PUT_BIG(6);
  for (size_t i = 0; i < 6; i++) {
    bytes_put(&out, tags[i], 4);
    PUT_BIG(i < 3 ? first + 20 * i : curve);
    PUT_BIG(i < 3 ? 20 : curve_size);
  }
  for (int c = 0; c < 3; c++) {
    bytes_put(&out, "XYZ \0\0\0\0", 8);
    for (int k = 0; k < 3; k++)
      PUT_BIG(columns[3 * c + k]);
  }
  bytes_put(&out, formula ? "para\0\0\0\0\0\3\0\0" : "curv\0\0\0\0\0\0\0\1\2\63", formula ? 12 : 14);
  for (int i = 0; formula && i < 5; i++)
    PUT_BIG(numbers[i]);
#undef PUT_BIG
  return out;
}

static void seed_colours(void) {
  static const char heif[] =
      "\0\0\0\14ftypheic\0\0\0\57meta\0\0\0\0\0\0\0\43iprp\0\0\0\33ipco\0\0\0\23colrnclx\0\11\0\20\0"
      "\11\200";
  for (int formula = 0; formula < 2; formula++) {
    file_bytes profile = make_profile(formula);
    file_bytes webp = {0};
    fuzz_seed(profile.data, profile.size);
    bytes_put(&webp, "RIFF....WEBPICCP", 16);
    bytes_u32(&webp, (uint32_t)profile.size);
    bytes_put(&webp, profile.data, profile.size);
    fuzz_seed_bytes(webp);
    bytes_free(&profile);
  }
  fuzz_seed(heif, sizeof heif - 1);
}

static const char *const colour_words[] = {"RGB ", "GRAY", "CMYK", "acsp", "rXYZ", "rTRC", "kTRC",
                                           "curv", "para", "desc", "mluc", "cicp", "meta", "iprp",
                                           "ipco", "colr", "prof", "nclx", "ICCP", "jp2h", NULL};
static const fuzz_target colours = {.name = "colours",
                                    .seeds = seed_colours,
                                    .run = run_colours,
                                    .words = colour_words,
                                    .memory = 4u << 20,
                                    .smoke = 2000};

const fuzz_target *const fuzz_targets[] = {&windows, &layers, &colours, NULL};
