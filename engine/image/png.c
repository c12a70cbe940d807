/* SPDX-License-Identifier: Apache-2.0 */
/* PNG files through libpng. libpng reports errors by longjmp: every function here that calls it sets the target
 * itself and returns at once after a jump, so that no local variable is read after one. */
#include <setjmp.h>
#include <stdio.h>

#include <png.h>
#include <zlib.h>

#include "base/bytes.h"
#include "base/memory.h"
#include "image/formats.h"
#include "image/pixels.h"

enum { SIGNATURE = 8, HEAD = 8, CHECKSUM = 4 };
enum { DEFLATE_RATIO = 1032 }; /* the most bytes that deflate makes of one */
enum { LEVEL = 4 };            /* of compression: 9 takes ten times as long for a few per cent */

/* libpng's objects, and what its callbacks work on. */
typedef struct png_state {
  png_structp png;
  png_infop info;
  const pags_encoded *file; /* read from */
  size_t at;
  pags_sink *sink; /* written to */
  bool out_of_memory;
  char message[128];
} png_state;

static void destroy_reader(png_state *state) {
  png_destroy_read_struct(&state->png, &state->info, NULL);
}

static void destroy_writer(png_state *state) {
  png_destroy_write_struct(&state->png, &state->info);
}

/* ---- Callbacks ---- */

static void on_error(png_structp png, png_const_charp text) {
  png_state *const state = png_get_error_ptr(png);
  snprintf(state->message, sizeof state->message, "%s", text ? text : "unknown error");
  png_longjmp(png, 1);
}

static void ignore_warning(png_structp png, png_const_charp text) {
  (void)png, (void)text;
}

static png_voidp allocate(png_structp png, png_alloc_size_t size) {
  png_state *const state = png_get_mem_ptr(png);
  void *const block = malloc(size);
  state->out_of_memory |= !block;
  return block;
}

static void release(PAGS_UNUSED png_structp png, png_voidp block) {
  free(block);
}

static void read_bytes(png_structp png, png_bytep bytes, size_t size) {
  png_state *const state = png_get_io_ptr(png);
  if (size > state->file->size - state->at)
    png_error(png, "the file is cut off");
  memcpy(bytes, state->file->bytes + state->at, size);
  state->at += size;
}

static void write_bytes(png_structp png, png_bytep bytes, size_t size) {
  png_state *const state = png_get_io_ptr(png);
  if (!pags_sink_put(state->sink, bytes, size)) {
    state->out_of_memory = true;
    png_error(png, "out of memory");
  }
}

static void flush_nothing(PAGS_UNUSED png_structp png) {}

/* ---- Reading ---- */

/* Fails if a chunk before the pixels claims to reach beyond the end of the file: libpng (1.6.39) would allocate the
 * length that a chunk claims, up to 2 GB, before it reads the chunk. A chunk is length, type, data and CRC (ISO/IEC
 * 15948, 5.3). */
static pags_result check_chunks(const pags_encoded *file) {
  for (size_t at = SIGNATURE; file->size >= HEAD && at <= file->size - HEAD;) {
    const uint8_t *const head = file->bytes + at;
    if (memcmp(head + 4, "IDAT", 4) == 0)
      return PAGS_OK;
    const uint32_t length = pags_load_big(head, 4);
    const uint64_t end = (uint64_t)at + HEAD + length + CHECKSUM;
    if (end > file->size)
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s: not a readable picture: the chunk at byte %zu is to hold %u bytes, the file ends at byte "
                       "%zu",
                       file->path, at, (unsigned)length, file->size);
    at = (size_t)end;
  }
  return PAGS_OK;
}

/* Reads the header and asks for samples of 8 or 16 bits, grey or RGB. Returns false after an error of libpng's. */
static bool read_header(png_state *state, int most) {
  if (setjmp(png_jmpbuf(state->png)))
    return false;
  png_set_read_fn(state->png, state, read_bytes);
  png_read_info(state->png, state->info);
  png_set_expand(state->png); /* 1, 2 and 4 bits to 8, a palette to RGB, a transparent colour to alpha */
  if (most == 3)
    png_set_strip_alpha(state->png);
  const uint16_t one = 1;
  if (*(const uint8_t *)&one == 1)
    png_set_swap(state->png); /* 16 bits are big-endian in the file */
  png_set_interlace_handling(state->png);
  return true;
}

static bool is_interlaced(const png_state *state) {
  return png_get_interlace_type(state->png, state->info) != PNG_INTERLACE_NONE;
}

/* Reads all rows of `image`; an interlaced picture is completed in seven passes. */
static bool read_rows(png_state *state, pags_image *image) {
  if (setjmp(png_jmpbuf(state->png)))
    return false;
  const bool interlaced = is_interlaced(state);
  const size_t bytes = png_get_rowbytes(state->png, state->info);
  for (int pass = 0; pass < (interlaced ? PNG_INTERLACE_ADAM7_PASSES : 1); pass++)
    for (int y = 0; y < image->height; y++)
      png_read_row(state->png, (png_bytep)image->data + (size_t)y * bytes, NULL);
  if (interlaced)
    png_read_end(state->png, NULL);
  return true;
}

static bool apply_transforms(png_state *state) {
  if (setjmp(png_jmpbuf(state->png)))
    return false;
  png_read_update_info(state->png, state->info);
  return true;
}

/* Fails with libpng's message. */
static pags_result explain(const png_state *state, const char *what) {
  return state->out_of_memory ? pags_out_of_memory("%s", state->file->path)
                              : pags_encoded_bad(state->file, what, "PNG", state->message);
}

/* Reads the header and fills `info` for the picture as it will be decoded; `least` gets the fewest bytes of a file
 * with that many samples. */
static pags_result begin(png_state *state, int most, pags_picture_info *info, uint64_t *least) {
  PAGS_TRY(check_chunks(state->file));
  state->png =
      png_create_read_struct_2(PNG_LIBPNG_VER_STRING, state, on_error, ignore_warning, state, allocate, release);
  state->info = state->png ? png_create_info_struct(state->png) : NULL;
  PAGS_CHECK_MEMORY(state->info, "%s", state->file->path);
  if (!read_header(state, most))
    return explain(state, PAGS_BAD_HEADER);
  *info = (pags_picture_info){.width = png_get_image_width(state->png, state->info),
                              .height = png_get_image_height(state->png, state->info),
                              .channels = png_get_channels(state->png, state->info)};
  *least = png_get_rowbytes(state->png, state->info) * (uint64_t)info->height / DEFLATE_RATIO;
  return PAGS_OK;
}

/* A chunk before the pixels; NULL: not found. check_chunks has found that all lie in the file. */
static const uint8_t *find_chunk(const pags_encoded *file, const char *type, uint32_t least) {
  for (size_t at = SIGNATURE; file->size >= HEAD && at <= file->size - HEAD;) {
    const uint8_t *const head = file->bytes + at;
    const uint32_t length = pags_load_big(head, 4);
    if (memcmp(head + 4, "IDAT", 4) == 0)
      return NULL;
    if (memcmp(head + 4, type, 4) == 0 && length >= least)
      return head + HEAD;
    at += HEAD + (size_t)length + CHECKSUM;
  }
  return NULL;
}

/* The profile in a chunk iCCP: a name, 0, a method, deflated bytes, the first four of which are their number. libpng
 * (1.6.39) drops those that it takes for unfit. NULL: it is damaged, or there is no memory; the caller frees it. */
static uint8_t *inflate_profile(const uint8_t *chunk, size_t *size) {
  const size_t length = pags_load_big(chunk - HEAD, 4);
  const uint8_t *const end = memchr(chunk, 0, length < 80 ? length : 80);
  const size_t at = end ? (size_t)(end - chunk) + 2 : length;
  uint8_t head[4] = {0};
  uLongf got = sizeof head;
  if (at >= length)
    return NULL;
  uncompress(head, &got, chunk + at, (uLong)(length - at)); /* no room for the rest */
  *size = pags_load_big(head, 4);
  PAGS_AUTOFREE uint8_t *profile = *size / DEFLATE_RATIO <= length ? malloc(*size + 1) : NULL;
  got = (uLongf)*size;
  const bool whole = profile && uncompress(profile, &got, chunk + at, (uLong)(length - at)) == Z_OK && got == *size;
  return whole ? pags_take(&profile) : NULL;
}

/* The space of the colours by the chunks that say it, the strongest first (W3C PNG, third edition, 4.3). libpng 1.6.39
 * doesn't know cICP. */
static void find_colour(const pags_encoded *file, pags_colour *colour) {
  const uint8_t *const cicp = find_chunk(file, "cICP", 4), *const gama = find_chunk(file, "gAMA", 4);
  const uint8_t *const chrm = find_chunk(file, "cHRM", 32), *const iccp = find_chunk(file, "iCCP", 1);
  const double steps = 100000;
  memset(colour, 0, sizeof *colour);
  if (cicp) {
    pags_colour_set_cicp(colour, cicp[0], cicp[1], cicp[3] != 0);
  } else if (iccp) {
    size_t size;
    PAGS_AUTOFREE uint8_t *profile = inflate_profile(iccp, &size);
    if (profile)
      pags_colour_set_icc(colour, profile, size);
    else
      pags_colour_set_unknown(colour, "a damaged ICC profile");
  } else if (!find_chunk(file, "sRGB", 1) && (gama || chrm)) {
    static const int order[8] = {2, 3, 4, 5, 6, 7, 0, 1}; /* white comes first in the file */
    const double stated = gama ? pags_load_big(gama, 4) : 0;
    double xy[8];
    for (int i = 0; chrm && i < 8; i++)
      xy[i] = pags_load_big(chrm + 4 * order[i], 4) / steps;
    pags_colour_set_gamma(colour, stated > 0 ? steps / stated : 0, chrm ? xy : NULL, NULL);
  }
}

pags_result pags_png_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour) {
  PAGS_AUTO(destroy_reader) png_state state = {.file = file};
  pags_picture_info info;
  uint64_t least;
  PAGS_TRY(begin(&state, 4, &info, &least));
  PAGS_TRY(pags_encoded_check(file, &info, 0));
  int orientation = 1;
#ifdef PNG_eXIf_SUPPORTED
  png_uint_32 size;
  png_bytep exif; /* of a chunk before the pixels */
  if (png_get_eXIf_1(state.png, state.info, &size, &exif))
    orientation = pags_orientation_of_exif(exif, size);
#endif
  *facts =
      (pags_image_facts){.width = (int)info.width,
                         .height = (int)info.height,
                         .alpha = (png_get_color_type(state.png, state.info) & PNG_COLOR_MASK_ALPHA) != 0 ||
                                  png_get_valid(state.png, state.info, PNG_INFO_tRNS),
                         .sample = png_get_bit_depth(state.png, state.info) == 16 ? PAGS_U16 : PAGS_U8,
                         .orientation = orientation,
                         .pixel_aspect = pags_pixel_aspect((double)png_get_pixel_aspect_ratio(state.png, state.info))};
  find_colour(file, colour);
  pags_colour_state(colour, facts);
  return PAGS_OK;
}

pags_result pags_png_decode(const pags_encoded *file, int most, pags_image *out) {
  PAGS_AUTO(destroy_reader) png_state state = {.file = file};
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_picture_info info;
  uint64_t least;
  memset(out, 0, sizeof *out);
  PAGS_TRY(begin(&state, most, &info, &least));
  PAGS_TRY(pags_encoded_check(file, &info, least));
  if (!apply_transforms(&state))
    return explain(&state, PAGS_BAD_HEADER);
  const bool top = file->rows > 0 && file->rows < info.height && !is_interlaced(&state);
  PAGS_TRY(pags_image_create(&image, (int)info.width, top ? file->rows : (int)info.height,
                             png_get_channels(state.png, state.info),
                             png_get_bit_depth(state.png, state.info) == 16 ? PAGS_U16 : PAGS_U8));
  if (!read_rows(&state, &image))
    return explain(&state, PAGS_BAD_SAMPLES);
  pags_image_move(&image, out);
  return PAGS_OK;
}

/* ---- Writing ---- */

/* Writes header, rows and end without filters, which cost more time than they save bytes in rendered pictures. */
static bool write_all(png_state *state, const pags_image *image) {
  static const int types[] = {PNG_COLOR_TYPE_GRAY, PNG_COLOR_TYPE_GRAY_ALPHA, PNG_COLOR_TYPE_RGB,
                              PNG_COLOR_TYPE_RGB_ALPHA};
  static char space[] = "oiio:ColorSpace", srgb[] = "sRGB", sampling[] = "jpeg:subsampling", full[] = "4:4:4";
  if (setjmp(png_jmpbuf(state->png)))
    return false;
  png_set_write_fn(state->png, state, write_bytes, flush_nothing);
  png_set_compression_level(state->png, LEVEL);
  png_set_compression_strategy(state->png, 0);
  png_set_filter(state->png, 0, PNG_NO_FILTERS);
  png_set_IHDR(state->png, state->info, (png_uint_32)image->width, (png_uint_32)image->height,
               image->sample == PAGS_U16 ? 16 : 8, types[image->channels - 1], PNG_INTERLACE_NONE,
               PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
  /* The offset and the texts say nothing. They are what PAGS 0.1.0 wrote: the same picture is the same bytes. */
  png_set_oFFs(state->png, state->info, 0, 0, PNG_OFFSET_PIXEL);
  png_set_sRGB_gAMA_and_cHRM(state->png, state->info, PNG_sRGB_INTENT_ABSOLUTE);
  const png_text texts[] = {{.compression = PNG_TEXT_COMPRESSION_NONE, .key = space, .text = srgb},
                            {.compression = PNG_TEXT_COMPRESSION_NONE, .key = sampling, .text = full}};
  png_set_text(state->png, state->info, texts, 2);
  png_write_info(state->png, state->info);
  const uint16_t one = 1;
  if (image->sample == PAGS_U16 && *(const uint8_t *)&one == 1)
    png_set_swap(state->png);
  const size_t bytes = (size_t)image->width * pags_pixel_bytes(image);
  for (int y = 0; y < image->height; y++)
    png_write_row(state->png, (png_const_bytep)image->data + (size_t)y * bytes);
  png_write_end(state->png, state->info);
  return true;
}

pags_result pags_png_encode(const char *path, const pags_image *image, pags_sink *out) {
  PAGS_AUTO(destroy_writer) png_state state = {.sink = out};
  state.png =
      png_create_write_struct_2(PNG_LIBPNG_VER_STRING, &state, on_error, ignore_warning, &state, allocate, release);
  state.info = state.png ? png_create_info_struct(state.png) : NULL;
  PAGS_CHECK_MEMORY(state.info, "%s", path);
  if (write_all(&state, image))
    return PAGS_OK;
  return state.out_of_memory ? pags_out_of_memory("%s", path)
                             : pags_fail(PAGS_ERROR_IO, "%s: can't be written: PNG: %s", path, state.message);
}
