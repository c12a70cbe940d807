/* SPDX-License-Identifier: Apache-2.0 */
/* JPEG files through libjpeg-turbo. libjpeg reports errors by longjmp: every function here that calls it sets the
 * target itself and returns at once after a jump, so that no local variable is read after one. */
#include <assert.h>
#include <setjmp.h>
#include <stdio.h>

#include <jerror.h>
#include <jpeglib.h>

#include "base/memory.h"
#include "image/formats.h"
#include "image/pixels.h"

enum { APP2 = 0xe2, END_OF_IMAGE = 0xd9, START_OF_SCAN = 0xda };
enum { FULL_CHROMA = 90 }; /* from this quality on, chroma keeps its resolution */
enum { MOST_SCANS = 500 }; /* progressive files have about ten; each takes time in proportion to the pixels */

/* libjpeg's error manager, first, and what comes out of it. */
typedef struct jpeg_errors {
  struct jpeg_error_mgr manager;
  jmp_buf jump;
  bool out_of_memory;
  char message[JMSG_LENGTH_MAX];
} jpeg_errors;

typedef struct jpeg_reader {
  struct jpeg_decompress_struct jpeg;
  struct jpeg_progress_mgr progress;
  jpeg_errors errors;
  const pags_encoded *file;
} jpeg_reader;

static void destroy_reader(jpeg_reader *r) {
  jpeg_destroy_decompress(&r->jpeg);
}

/* ---- Errors ---- */

static void on_error(j_common_ptr jpeg) {
  jpeg_errors *const errors = (jpeg_errors *)jpeg->err;
  errors->out_of_memory = jpeg->err->msg_code == JERR_OUT_OF_MEMORY;
  jpeg->err->format_message(jpeg, errors->message);
  longjmp(errors->jump, 1);
}

/* Warnings, as of a damaged block that is decoded as far as it goes. */
static void ignore_message(PAGS_UNUSED j_common_ptr jpeg) {}

static struct jpeg_error_mgr *set_errors(jpeg_errors *errors) {
  jpeg_std_error(&errors->manager);
  errors->manager.error_exit = on_error;
  errors->manager.output_message = ignore_message;
  return &errors->manager;
}

static void check_scans(j_common_ptr jpeg) {
  jpeg_errors *const errors = (jpeg_errors *)jpeg->err;
  if (((j_decompress_ptr)jpeg)->input_scan_number <= MOST_SCANS)
    return;
  snprintf(errors->message, sizeof errors->message, "it has more than %d scans", MOST_SCANS);
  longjmp(errors->jump, 1);
}

/* Fails with libjpeg's message. */
static pags_result explain(const jpeg_reader *r, const char *what) {
  return r->errors.out_of_memory ? pags_out_of_memory("%s", r->file->path)
                                 : pags_encoded_bad(r->file, what, "JPEG", r->errors.message);
}

/* ---- Reading ---- */

/* Is the file cut off: is there no end-of-image marker after the beginning of the first scan? The search runs from the
 * end of the file, because cameras append data of their own after the marker, but not much. The segments before the
 * scan must be skipped, because a thumbnail in them has an end-of-image marker of its own; malformed ones are reported
 * by the decoder. */
static bool is_cut_off(const pags_encoded *file) {
  size_t scan = 2, length;
  while (pags_jpeg_segment(file->bytes, file->size, &scan, &length))
    ;
  if (scan + 4 > file->size || file->bytes[scan] != 0xff || file->bytes[scan + 1] != START_OF_SCAN)
    return false;
  for (size_t i = file->size - 1; i > scan; i--)
    if (file->bytes[i] == END_OF_IMAGE && file->bytes[i - 1] == 0xff)
      return false;
  return true;
}

static bool read_header(jpeg_reader *r) {
  if (setjmp(r->errors.jump))
    return false;
  jpeg_create_decompress(&r->jpeg);
  r->progress.progress_monitor = check_scans;
  r->jpeg.progress = &r->progress;
  jpeg_mem_src(&r->jpeg, r->file->bytes, (unsigned long)r->file->size);
  jpeg_read_header(&r->jpeg, TRUE);
  return true;
}

static bool start(jpeg_reader *r) {
  if (setjmp(r->errors.jump))
    return false;
  if (r->jpeg.jpeg_color_space == JCS_YCCK)
    r->jpeg.out_color_space = JCS_CMYK;
  jpeg_start_decompress(&r->jpeg);
  return true;
}

/* Reads all rows into `out`. A row whose channels differ from the file's goes through `row`. */
static bool read_rows(jpeg_reader *r, uint8_t *row, pags_image *out) {
  if (setjmp(r->errors.jump))
    return false;
  const size_t width = (size_t)out->width, channels = (size_t)out->channels, stored = (size_t)r->jpeg.output_components;
  const bool cmyk = r->jpeg.out_color_space == JCS_CMYK;
  const float scale = 1 / 255.0f;
  while (r->jpeg.output_scanline < r->jpeg.output_height) {
    uint8_t *const to = (uint8_t *)out->data + r->jpeg.output_scanline * width * channels;
    JSAMPROW rows[1] = {row ? row : to};
    jpeg_read_scanlines(&r->jpeg, rows, 1);
    for (size_t x = 0; row && x < width; x++)
      for (size_t c = 0; c < channels; c++) {
        const uint8_t *const from = row + x * stored;
        const float colour = (float)from[c] * scale;
        to[x * channels + c] = cmyk ? (uint8_t)(colour * ((float)from[3] * scale) * 255.0f + 0.5f) : from[c];
      }
  }
  return true;
}

/* Reads the header and checks the size. */
static pags_result begin(jpeg_reader *r, pags_picture_info *info) {
  r->jpeg.err = set_errors(&r->errors);
  if (!read_header(r))
    return explain(r, PAGS_BAD_HEADER);
  *info = (pags_picture_info){
      .width = r->jpeg.image_width, .height = r->jpeg.image_height, .channels = r->jpeg.num_components};
  return pags_encoded_check(r->file, info, 0);
}

/* Joins the parts of an ICC profile, which segments APP2 hold: a name of 12 bytes, the part's number from 1 on, the
 * number of parts (ICC.1, B.4). NULL: not found (*size 0), it isn't whole, or there is no memory (*size not 0). */
static uint8_t *join_profile(const pags_encoded *file, size_t *size) {
  static const uint8_t name[12] = "ICC_PROFILE";
  const uint8_t *parts[256] = {NULL};
  size_t sizes[256] = {0}, all = 0;
  int count = 0, there = 0;
  const uint8_t *segment;
  size_t at = 2, length;
  while ((segment = pags_jpeg_segment(file->bytes, file->size, &at, &length)))
    if (segment[1] == APP2 && length >= 16 && at <= file->size && memcmp(segment + 4, name, sizeof name) == 0 &&
        !parts[segment[16]]) {
      parts[segment[16]] = segment + 18;
      sizes[segment[16]] = length - 16;
      all += length - 16;
      count = segment[17];
      there++;
    }
  *size = all + (there > 0);
  bool whole = there > 0 && there == count;
  for (int i = 1; i <= count && whole; i++)
    whole = parts[i];
  uint8_t *const profile = whole ? malloc(all + 1) : NULL;
  size_t used = 0;
  for (int i = 1; i <= count && profile; used += sizes[i], i++)
    memcpy(profile + used, parts[i], sizes[i]);
  return profile;
}

/* The space of the colours: that of the profile, or what EXIF says. */
static void find_colour(const pags_encoded *file, const uint8_t *exif, size_t exif_size, pags_colour *colour) {
  size_t size;
  PAGS_AUTOFREE uint8_t *profile = join_profile(file, &size);
  memset(colour, 0, sizeof *colour);
  if (profile)
    pags_colour_set_icc(colour, profile, size - 1);
  else if (size > 0)
    pags_colour_set_unknown(colour, "a damaged ICC profile");
  else if (exif && pags_exif_says_adobe_rgb(exif, exif_size))
    pags_colour_set_adobe_rgb(colour);
}

pags_result pags_jpeg_inspect(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour) {
  PAGS_AUTO(destroy_reader) jpeg_reader r = {.file = file};
  pags_picture_info info;
  size_t size = 0;
  PAGS_TRY(begin(&r, &info));
  const uint8_t *const exif = pags_exif_of_jpeg(file->bytes, file->size, &size);
  /* A JFIF segment may state the ratio of a pixel's sides by its densities. */
  const bool stated = r.jpeg.saw_JFIF_marker && r.jpeg.X_density > 0;
  *facts =
      (pags_image_facts){.width = (int)info.width,
                         .height = (int)info.height,
                         .orientation = exif ? pags_orientation_of_exif(exif, size) : 1,
                         .pixel_aspect = pags_pixel_aspect(stated ? (double)r.jpeg.Y_density / r.jpeg.X_density : 0)};
  find_colour(file, exif, size, colour);
  pags_colour_state(colour, facts);
  return PAGS_OK;
}

pags_result pags_jpeg_decode(const pags_encoded *file, int most, pags_image *out) {
  PAGS_AUTO(destroy_reader) jpeg_reader r = {.file = file};
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_picture_info info;
  memset(out, 0, sizeof *out);
  PAGS_TRY(begin(&r, &info));
  /* The fewest bytes: one bit for each block of 8 x 8 pixels. Arithmetic coding takes less. */
  const uint64_t blocks = (((uint64_t)info.width + 7) / 8) * (((uint64_t)info.height + 7) / 8);
  PAGS_TRY(pags_encoded_check(file, &info, blocks / (r.jpeg.arith_code ? 512 : 8)));
  if (!start(&r))
    return explain(&r, PAGS_BAD_HEADER);
  const int stored = r.jpeg.output_components;
  const int channels = r.jpeg.out_color_space == JCS_CMYK ? 3 : stored < most ? stored : most;
  PAGS_TRY(pags_image_create(&image, (int)r.jpeg.output_width, (int)r.jpeg.output_height, channels, PAGS_U8));
  PAGS_AUTOFREE uint8_t *row = channels == stored ? NULL : malloc(r.jpeg.output_width * (size_t)stored);
  PAGS_CHECK_MEMORY(channels == stored || row, "%s", file->path);
  if (!read_rows(&r, row, &image))
    return explain(&r, PAGS_BAD_SAMPLES);
  if (is_cut_off(file))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: can't be decoded: the file is cut off after %zu bytes", file->path,
                     file->size);
  pags_image_move(&image, out);
  return PAGS_OK;
}

/* ---- Writing ---- */

/* A destination of libjpeg's, first, that flushes a buffer into a sink. */
typedef struct jpeg_target {
  struct jpeg_destination_mgr manager;
  pags_sink *sink;
  uint8_t buffer[4096];
} jpeg_target;

typedef struct jpeg_writer {
  struct jpeg_compress_struct jpeg;
  jpeg_errors errors;
  jpeg_target target;
} jpeg_writer;

static void destroy_writer(jpeg_writer *w) {
  jpeg_destroy_compress(&w->jpeg);
}

static void begin_target(j_compress_ptr jpeg) {
  jpeg_target *const target = (jpeg_target *)jpeg->dest;
  target->manager.next_output_byte = target->buffer;
  target->manager.free_in_buffer = sizeof target->buffer;
}

static void put(j_compress_ptr jpeg, size_t size) {
  jpeg_target *const target = (jpeg_target *)jpeg->dest;
  if (!pags_sink_put(target->sink, target->buffer, size))
    ERREXIT1(jpeg, JERR_OUT_OF_MEMORY, 0);
}

static boolean flush_target(j_compress_ptr jpeg) {
  put(jpeg, sizeof((jpeg_target *)jpeg->dest)->buffer);
  begin_target(jpeg);
  return TRUE;
}

static void end_target(j_compress_ptr jpeg) {
  put(jpeg, sizeof((jpeg_target *)jpeg->dest)->buffer - jpeg->dest->free_in_buffer);
}

/* An EXIF segment that says: version 2.3, components in the order Y Cb Cr, colours are sRGB. A TIFF header,
 * directory 0 with the place of the EXIF directory, and that directory; entries are tag, type, count and value,
 * little-endian (CIPA DC-008). */
static const uint8_t exif[] = {'E', 'x', 'i', 'f', 0, 0,    'I', 'I', 42,  0,   8, 0,    0,   0,   1,   0,   0x69, 0x87,
                               4,   0,   1,   0,   0, 0,    26,  0,   0,   0,   0, 0,    0,   0,   4,   0,   0,    0x90,
                               7,   0,   4,   0,   0, 0,    '0', '2', '3', '0', 1, 0x91, 7,   0,   4,   0,   0,    0,
                               1,   2,   3,   0,   0, 0xa0, 7,   0,   4,   0,   0, 0,    '0', '1', '0', '0', 1,    0xa0,
                               3,   0,   1,   0,   0, 0,    1,   0,   0,   0,   0, 0,    0,   0};

static bool write_all(jpeg_writer *w, const pags_image *image, int quality) {
  if (setjmp(w->errors.jump))
    return false;
  struct jpeg_compress_struct *const jpeg = &w->jpeg;
  jpeg_create_compress(jpeg);
  jpeg->dest = &w->target.manager;
  jpeg->image_width = (JDIMENSION)image->width;
  jpeg->image_height = (JDIMENSION)image->height;
  jpeg->input_components = image->channels;
  jpeg->in_color_space = image->channels == 3 ? JCS_RGB : JCS_GRAYSCALE;
  jpeg_set_defaults(jpeg);
  jpeg_set_quality(jpeg, quality, TRUE);
  if (quality >= FULL_CHROMA)
    jpeg->comp_info[0].h_samp_factor = jpeg->comp_info[0].v_samp_factor = 1; /* chroma's factors are 1 */
  jpeg_start_compress(jpeg, TRUE);
  jpeg_write_marker(jpeg, JPEG_APP0 + 1, exif, sizeof exif);
  const size_t bytes = (size_t)image->width * (size_t)image->channels;
  while (jpeg->next_scanline < jpeg->image_height) {
    JSAMPROW rows[1] = {(uint8_t *)image->data + jpeg->next_scanline * bytes};
    jpeg_write_scanlines(jpeg, rows, 1);
  }
  jpeg_finish_compress(jpeg);
  return true;
}

pags_result pags_jpeg_encode(const char *path, const pags_image *image, int quality, pags_sink *out) {
  assert(image->sample == PAGS_U8 && (image->channels == 1 || image->channels == 3));
  PAGS_AUTO(destroy_writer)
  jpeg_writer w = {.target = {.manager = {.init_destination = begin_target,
                                          .empty_output_buffer = flush_target,
                                          .term_destination = end_target},
                              .sink = out}};
  w.jpeg.err = set_errors(&w.errors);
  if (write_all(&w, image, quality))
    return PAGS_OK;
  return w.errors.out_of_memory ? pags_out_of_memory("%s", path)
                                : pags_fail(PAGS_ERROR_IO, "%s: can't be written: JPEG: %s", path, w.errors.message);
}
