/* SPDX-License-Identifier: Apache-2.0 */
/* Makes picture files by the libraries that decode them. Their default error handlers end the program. */
#include "picture_files.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jpeglib.h>
#include <openexr.h>
#include <png.h>

enum { MOST = 8 }; /* largest number of channels */

/* A sample of 16 bits: slopes with some noise, to test both kinds of compression. */
static unsigned sample_at(int x, int y, int c) {
  const unsigned noise = (unsigned)x * 2654435761u ^ (unsigned)(y + 7 * c) * 2246822519u;
  return ((unsigned)(x * 1500 + y * 900 + c * 9000) + (noise >> 13 & 1023)) & 65535;
}

static void check(int condition, const char *what) {
  if (condition)
    return;
  fprintf(stderr, "picture_files: %s\n", what);
  abort();
}

/* ---- PNG ---- */

static void append_png(png_structp png, png_bytep bytes, size_t size) {
  bytes_put(png_get_io_ptr(png), bytes, size);
}

static void flush_png(png_structp png) {
  (void)png;
}

typedef struct png_kind {
  int type, bits;
  const char *name;
} png_kind;

static const png_kind png_kinds[] = {{PNG_COLOR_TYPE_GRAY, 1, "grey1"},
                                     {PNG_COLOR_TYPE_GRAY, 2, "grey2"},
                                     {PNG_COLOR_TYPE_GRAY, 4, "grey4"},
                                     {PNG_COLOR_TYPE_GRAY, 8, "grey8"},
                                     {PNG_COLOR_TYPE_GRAY, 16, "grey16"},
                                     {PNG_COLOR_TYPE_PALETTE, 1, "palette1"},
                                     {PNG_COLOR_TYPE_PALETTE, 2, "palette2"},
                                     {PNG_COLOR_TYPE_PALETTE, 4, "palette4"},
                                     {PNG_COLOR_TYPE_PALETTE, 8, "palette8"},
                                     {PNG_COLOR_TYPE_RGB, 8, "rgb8"},
                                     {PNG_COLOR_TYPE_RGB, 16, "rgb16"},
                                     {PNG_COLOR_TYPE_GRAY_ALPHA, 8, "greyalpha8"},
                                     {PNG_COLOR_TYPE_GRAY_ALPHA, 16, "greyalpha16"},
                                     {PNG_COLOR_TYPE_RGB_ALPHA, 8, "rgba8"},
                                     {PNG_COLOR_TYPE_RGB_ALPHA, 16, "rgba16"}};
enum { PNG_KINDS = sizeof png_kinds / sizeof *png_kinds, PNG_VARIANTS = 6 };

/* Variants: plain; interlaced; with a transparent colour; both; with gamma, offset and a text; with an sRGB mark and
 * significant bits. */
static int make_png(int kind, int width, int height, file_bytes *out, char name[96]) {
  if (kind >= PNG_KINDS * PNG_VARIANTS)
    return 0;
  const png_kind *const k = &png_kinds[kind % PNG_KINDS];
  const int variant = kind / PNG_KINDS, interlaced = variant == 1 || variant == 3;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
  png_infop info = png_create_info_struct(png);
  png_set_write_fn(png, out, append_png, flush_png);
  png_set_IHDR(png, info, (png_uint_32)width, (png_uint_32)height, k->bits, k->type,
               interlaced ? PNG_INTERLACE_ADAM7 : PNG_INTERLACE_NONE, 0, 0);
  if (k->type == PNG_COLOR_TYPE_PALETTE) {
    png_color palette[256];
    for (int i = 0; i < 1 << k->bits; i++)
      palette[i] = (png_color){(png_byte)(i * 37), (png_byte)(255 - i), (png_byte)(i * i)};
    png_set_PLTE(png, info, palette, 1 << k->bits);
  }
  if ((variant == 2 || variant == 3) && !(k->type & PNG_COLOR_MASK_ALPHA)) {
    png_byte alpha[3] = {0, 100, 200};
    const png_uint_16 value = (png_uint_16)((1 << k->bits) - 1);
    png_color_16 colour = {.gray = value, .red = value, .green = value, .blue = value};
    png_set_tRNS(png, info, alpha, k->bits == 1 ? 2 : 3, &colour);
  }
  if (variant == 4) {
    char key[] = "Title", text[] = "a gamma of 1/1.8";
    const png_text title = {.compression = PNG_TEXT_COMPRESSION_NONE, .key = key, .text = text};
    png_set_gAMA(png, info, 1 / 1.8);
    png_set_oFFs(png, info, 5, -3, PNG_OFFSET_PIXEL);
    png_set_text(png, info, &title, 1);
  }
  if (variant == 5) {
    const png_byte bits = (png_byte)(k->bits > 1 && k->type != PNG_COLOR_TYPE_PALETTE ? k->bits - 1 : 1);
    png_set_sRGB(png, info, PNG_sRGB_INTENT_PERCEPTUAL);
    png_set_sBIT(png, info, &(png_color_8){bits, bits, bits, bits, bits});
  }
  png_write_info(png, info);
  const size_t bytes = png_get_rowbytes(png, info);
  const int channels = png_get_channels(png, info);
  png_byte *const rows = calloc((size_t)height, bytes);
  png_bytep *const pointers = calloc((size_t)height, sizeof *pointers);
  check(rows && pointers, "out of memory");
  for (int y = 0; y < height; y++) {
    png_byte *const row = pointers[y] = rows + (size_t)y * bytes;
    for (int i = 0; i < width * channels; i++) {
      const unsigned sample = sample_at(i / channels, y, i % channels);
      if (k->bits == 16) {
        row[2 * i] = (png_byte)(sample >> 8);
        row[2 * i + 1] = (png_byte)sample;
      } else {
        const int bit = i * k->bits;
        row[bit / 8] |= (png_byte)(sample >> (16 - k->bits) << (8 - k->bits - bit % 8));
      }
    }
  }
  png_write_image(png, pointers);
  png_write_end(png, info);
  png_destroy_write_struct(&png, &info);
  free(pointers);
  free(rows);
  snprintf(name, 96, "%s-variant%d-%dx%d.png", k->name, variant, width, height);
  return 1;
}

/* ---- JPEG ---- */

typedef struct jpeg_kind {
  const char *name;
  J_COLOR_SPACE in, stored;
  int channels, across, down; /* the first channel's sampling factors */
  int progressive, restart, arithmetic, quality;
} jpeg_kind;

static const jpeg_kind jpeg_kinds[] = {{"grey", JCS_GRAYSCALE, JCS_GRAYSCALE, 1, 1, 1, 0, 0, 0, 90},
                                       {"444", JCS_RGB, JCS_YCbCr, 3, 1, 1, 0, 0, 0, 95},
                                       {"422", JCS_RGB, JCS_YCbCr, 3, 2, 1, 0, 0, 0, 90},
                                       {"420", JCS_RGB, JCS_YCbCr, 3, 2, 2, 0, 0, 0, 75},
                                       {"440", JCS_RGB, JCS_YCbCr, 3, 1, 2, 0, 0, 0, 75},
                                       {"411", JCS_RGB, JCS_YCbCr, 3, 4, 1, 0, 0, 0, 50},
                                       {"rgb", JCS_RGB, JCS_RGB, 3, 1, 1, 0, 0, 0, 95},
                                       {"cmyk", JCS_CMYK, JCS_CMYK, 4, 1, 1, 0, 0, 0, 100},
                                       {"ycck", JCS_CMYK, JCS_YCCK, 4, 2, 2, 0, 0, 0, 95},
                                       {"progressive", JCS_RGB, JCS_YCbCr, 3, 2, 2, 1, 0, 0, 80},
                                       {"progressive-grey", JCS_GRAYSCALE, JCS_GRAYSCALE, 1, 1, 1, 1, 0, 0, 80},
                                       {"progressive-cmyk", JCS_CMYK, JCS_CMYK, 4, 1, 1, 1, 0, 0, 80},
                                       {"restart", JCS_RGB, JCS_YCbCr, 3, 2, 2, 0, 3, 0, 80},
                                       {"arithmetic", JCS_RGB, JCS_YCbCr, 3, 2, 2, 0, 0, 1, 80},
                                       {"two", JCS_UNKNOWN, JCS_UNKNOWN, 2, 1, 1, 0, 0, 0, 95}};
enum { JPEG_KINDS = sizeof jpeg_kinds / sizeof *jpeg_kinds };

static int make_jpeg(int kind, int width, int height, file_bytes *out, char name[96]) {
  if (kind >= JPEG_KINDS)
    return 0;
  /* EXIF: one directory with one entry, Orientation = 6 (turned by a quarter) */
  static const uint8_t turned[] = {'E',  'x', 'i', 'f', 0, 0, 'I', 'I', 42, 0, 8, 0, 0, 0, 1, 0,
                                   0x12, 1,   3,   0,   1, 0, 0,   0,   6,  0, 0, 0, 0, 0, 0, 0};
  const jpeg_kind *const k = &jpeg_kinds[kind];
  struct jpeg_compress_struct jpeg = {0};
  struct jpeg_error_mgr errors;
  unsigned char *bytes = NULL;
  unsigned long size = 0;
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = (JDIMENSION)width;
  jpeg.image_height = (JDIMENSION)height;
  jpeg.input_components = k->channels;
  jpeg.in_color_space = k->in;
  jpeg_set_defaults(&jpeg);
  jpeg_set_colorspace(&jpeg, k->stored);
  jpeg_set_quality(&jpeg, k->quality, TRUE);
  jpeg.comp_info[0].h_samp_factor = k->across;
  jpeg.comp_info[0].v_samp_factor = k->down;
  if (k->stored == JCS_YCCK) {
    jpeg.comp_info[3].h_samp_factor = k->across;
    jpeg.comp_info[3].v_samp_factor = k->down;
  }
  jpeg.restart_interval = (unsigned)k->restart;
  jpeg.arith_code = k->arithmetic;
  if (k->progressive)
    jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  jpeg_write_marker(&jpeg, JPEG_APP0 + 1, turned, sizeof turned);
  uint8_t *const row = malloc((size_t)(width * k->channels));
  check(row != NULL, "out of memory");
  while (jpeg.next_scanline < jpeg.image_height) {
    for (int i = 0; i < width * k->channels; i++)
      row[i] = (uint8_t)(sample_at(i / k->channels, (int)jpeg.next_scanline, i % k->channels) >> 8);
    JSAMPROW rows[1] = {row};
    jpeg_write_scanlines(&jpeg, rows, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  bytes_put(out, bytes, size);
  free(bytes);
  free(row);
  snprintf(name, 96, "%s-%dx%d.jpg", k->name, width, height);
  return 1;
}

/* ---- EXR ---- */

typedef struct exr_kind {
  const char *name;
  const char *channels[MOST];
  const char *types; /* h, f or u for each channel */
} exr_kind;

static const exr_kind exr_kinds[] = {
    {"rgb-half", {"R", "G", "B"}, "hhh"},
    {"rgb-float", {"B", "G", "R"}, "fff"},
    {"rgba-half", {"A", "B", "G", "R"}, "hhhh"},
    {"rgba-float", {"R", "G", "B", "A"}, "ffff"},
    {"grey-half", {"Y"}, "h"},
    {"depth", {"Z"}, "f"},
    {"one", {"id"}, "h"},
    {"grey-alpha", {"A", "Y"}, "hf"},
    {"mixed", {"R", "G", "B", "A", "Z", "id"}, "hhhhfu"},
    {"mixed-first", {"id", "L.R", "L.uv.x", "L.B", "L.G"}, "uhffh"},
    {"normals", {"N.X", "N.Y", "N.Z", "Y"}, "hhhf"},
    {"layers", {"diffuse.R", "diffuse.G", "diffuse.B", "Z", "alpha"}, "hhhff"},
    {"points", {"P.Z", "P.Y", "P.X", "red", "Blue", "green"}, "fffhhh"},
    {"combined",
     {"V.AO.R", "V.AO.G", "V.AO.B", "V.Combined.A", "V.Combined.B", "V.Combined.G", "V.Combined.R", "V.Depth.Z"},
     "hhhffffu"}};
static const struct {
  const char *name;
  exr_compression_t compression;
} exr_packings[] = {{"none", EXR_COMPRESSION_NONE},
                    {"rle", EXR_COMPRESSION_RLE},
                    {"zips", EXR_COMPRESSION_ZIPS},
                    {"zip", EXR_COMPRESSION_ZIP},
                    {"piz", EXR_COMPRESSION_PIZ}};
enum { EXR_KINDS = sizeof exr_kinds / sizeof *exr_kinds, EXR_PACKINGS = sizeof exr_packings / sizeof *exr_packings };

static int64_t append_exr(exr_const_context_t context, void *user, const void *bytes, uint64_t size, uint64_t at,
                          exr_stream_error_func_ptr_t error) {
  (void)context, (void)error;
  file_bytes *const out = user;
  while (out->size < at + size)
    bytes_u8(out, 0);
  memcpy(out->data + at, bytes, size);
  return (int64_t)size;
}

/* Half-precision samples take all bit patterns one after another, including infinities and NaN. */
static void fill_exr(int x, int y, int c, int type, void *to) {
  const unsigned sample = sample_at(x, y, c);
  const uint16_t half = (uint16_t)(sample % 3 ? (unsigned)(x + 64 * y + 8192 * c) * 7 : sample >> 2);
  const float real = sample % 5 ? (float)sample * 0.01f - 100 : 1e30f / (float)(sample + 1);
  const uint32_t number = sample % 2 ? sample : sample * 65537u;
  if (type == 'h')
    memcpy(to, &half, 2);
  else
    memcpy(to, type == 'f' ? (const void *)&real : &number, 4);
}

static void write_exr_blocks(exr_context_t context, const exr_kind *k, int width, int height, int first) {
  exr_chunk_info_t block;
  exr_encode_pipeline_t pipeline = EXR_ENCODE_PIPELINE_INITIALIZER;
  uint8_t *const planes = calloc((size_t)width * (size_t)height, 4 * MOST);
  check(planes != NULL, "out of memory");
  for (int y = 0; y < height; y += block.height) {
    check(exr_write_scanline_chunk_info(context, 0, first + y, &block) == EXR_ERR_SUCCESS, "a block's place");
    check((y == 0 ? exr_encoding_initialize(context, 0, &block, &pipeline)
                  : exr_encoding_update(context, 0, &block, &pipeline)) == EXR_ERR_SUCCESS,
          "a block's channels");
    for (int i = 0; i < pipeline.channel_count; i++) {
      exr_coding_channel_info_t *const channel = &pipeline.channels[i];
      int c = 0;
      while (strcmp(k->channels[c], channel->channel_name) != 0)
        c++;
      uint8_t *const plane = planes + (size_t)width * (size_t)height * 4 * (size_t)c;
      for (int row = 0; row < block.height; row++)
        for (int x = 0; x < width; x++)
          fill_exr(x, y + row, c, k->types[c], plane + (size_t)(row * width + x) * (size_t)channel->bytes_per_element);
      channel->encode_from_ptr = plane;
      channel->user_pixel_stride = channel->user_bytes_per_element;
      channel->user_line_stride = channel->user_bytes_per_element * width;
    }
    if (y == 0)
      check(exr_encoding_choose_default_routines(context, 0, &pipeline) == EXR_ERR_SUCCESS, "the routines");
    check(exr_encoding_run(context, 0, &pipeline) == EXR_ERR_SUCCESS, "a block");
  }
  exr_encoding_destroy(context, &pipeline);
  free(planes);
}

static int make_exr(int kind, int width, int height, file_bytes *out, char name[96]) {
  if (kind >= EXR_KINDS * EXR_PACKINGS)
    return 0;
  const exr_kind *const k = &exr_kinds[kind % EXR_KINDS];
  const int packing = kind / EXR_KINDS, left = kind % 3 - 1, top = 4 - kind % 7;
  /* Display windows: equal to the data window, larger, smaller, and partly overlapping. */
  static const int shifts[4][4] = {{0, 0, 0, 0}, {-2, -1, 3, 1}, {1, 1, -1, -1}, {-3, 1, -1, 2}};
  const int *const shift = shifts[width > 2 && height > 2 ? kind % 4 : kind % 2];
  exr_context_t context;
  exr_context_initializer_t setup = EXR_DEFAULT_CONTEXT_INITIALIZER;
  setup.user_data = out;
  setup.write_fn = append_exr;
  int part;
  check(exr_start_write(&context, "kind.exr", EXR_WRITE_FILE_DIRECTLY, &setup) == EXR_ERR_SUCCESS, "start");
  check(exr_add_part(context, NULL, EXR_STORAGE_SCANLINE, &part) == EXR_ERR_SUCCESS, "a part");
  check(exr_initialize_required_attr_simple(context, part, width, height, exr_packings[packing].compression) ==
            EXR_ERR_SUCCESS,
        "the header");
  const exr_attr_box2i_t window = {.min = {.x = left, .y = top}, .max = {.x = left + width - 1, .y = top + height - 1}};
  check(exr_set_data_window(context, part, &window) == EXR_ERR_SUCCESS, "the window");
  const exr_attr_box2i_t shown = {.min = {.x = left + shift[0], .y = top + shift[1]},
                                  .max = {.x = window.max.x + shift[2], .y = window.max.y + shift[3]}};
  check(exr_set_display_window(context, part, &shown) == EXR_ERR_SUCCESS, "the display window");
  for (int c = 0; k->types[c]; c++)
    check(exr_add_channel(context, part, k->channels[c],
                          k->types[c] == 'h'   ? EXR_PIXEL_HALF
                          : k->types[c] == 'f' ? EXR_PIXEL_FLOAT
                                               : EXR_PIXEL_UINT,
                          EXR_PERCEPTUALLY_LOGARITHMIC, 1, 1) == EXR_ERR_SUCCESS,
          "a channel");
  check(exr_write_header(context) == EXR_ERR_SUCCESS, "the header");
  write_exr_blocks(context, k, width, height, top);
  check(exr_finish(&context) == EXR_ERR_SUCCESS, "the end");
  snprintf(name, 96, "%s-%s-%dx%d.exr", k->name, exr_packings[packing].name, width, height);
  return 1;
}

int picture_file(picture_format format, int kind, int width, int height, file_bytes *out, char name[96]) {
  *out = (file_bytes){0};
  return format == PICTURE_PNG    ? make_png(kind, width, height, out, name)
         : format == PICTURE_JPEG ? make_jpeg(kind, width, height, out, name)
                                  : make_exr(kind, width, height, out, name);
}
