/* SPDX-License-Identifier: Apache-2.0 */
/* Reading and writing picture files. The decoder is chosen by how a file begins: PNG, JPEG and EXR have their own, what
 * is not one of these, or of another kind than they read, is given to OpenImageIO (other.h). */
#include <assert.h>
#include <errno.h>
#include <stdio.h>
#include <strings.h>

#include "base/file.h"
#include "base/memory.h"
#include "image/formats.h"
#include "image/other.h"
#include "image/pixels.h"
#include "port/port.h"

/* ---- Formats ---- */

enum { MAGIC = 8 };

typedef struct picture_format {
  uint8_t magic[MAGIC]; /* how its files begin */
  size_t magic_size;
  pags_result (*inspect)(const pags_encoded *file, pags_image_facts *facts, pags_colour *colour);
  pags_result (*decode)(const pags_encoded *file, int most, pags_image *out);
} picture_format;

/* Returns the format of a file that begins so, NULL for another. A file that ends within the first bytes of a format is
 * one of that format, cut off. */
static const picture_format *find_format(const uint8_t *bytes, size_t size) {
  static const picture_format formats[] = {
      {{0x89, 'P', 'N', 'G', '\r', '\n', 0x1a, '\n'}, 8, pags_png_inspect, pags_png_decode},
      {{0xff, 0xd8}, 2, pags_jpeg_inspect, pags_jpeg_decode},
      {{0x76, 0x2f, 0x31, 0x01}, 4, pags_exr_inspect, pags_exr_decode},
  };
  for (size_t i = 0; i < sizeof formats / sizeof *formats; i++)
    if (size > 0 && memcmp(bytes, formats[i].magic, size < formats[i].magic_size ? size : formats[i].magic_size) == 0)
      return &formats[i];
  return NULL;
}

/* Fails with PAGS_ERROR_UNSUPPORTED because a file is of none of the formats above, or with PAGS_ERROR_FORMAT if it is
 * empty or of a format that no photograph has and whose reader in OpenImageIO crashes where a file is cut off. */
static pags_result refuse(const char *path, const uint8_t *bytes, size_t size) {
  static const struct {
    const char *magic, *name;
  } known[] = {{"RIFF", "a WebP"}, {"II*", "a TIFF"}, {"MM", "a TIFF"}, {"GIF8", "a GIF"},
               {"BM", "a BMP"},    {"P6", "a PPM"},   {"P5", "a PGM"},  {"#?", "a Radiance HDR"},
               {"8BPS", "a PSD"},  {"SDPX", "a DPX"}, {"XPDS", "a DPX"}};
  const char *name = "no picture that is known by its first bytes";
  for (size_t i = 0; i < sizeof known / sizeof *known; i++)
    if (size >= strlen(known[i].magic) && memcmp(bytes, known[i].magic, strlen(known[i].magic)) == 0)
      name = known[i].name;
  if (size == 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: is empty, expected a picture", path);
  const bool icon = size >= 4 && memcmp(bytes, "\0\0\1\0", 4) == 0;
  if (icon || (size >= 4 && (memcmp(bytes, "FOR4", 4) == 0 || memcmp(bytes, "FORM", 4) == 0)))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: %s, which isn't read: expected a photograph, such as a PNG", path,
                     icon ? "an icon" : "an IFF");
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: PNG, JPEG and EXR are read; this file is %s", path, name);
}

/* ---- Reading ---- */

enum { BEGIN = 1 << 17 }; /* bytes, in which most headers lie */

/* Reads the first `most` bytes of a file, or all if it has fewer. A missing, unreadable or wrong kind of path is
 * reported here, before a decoder reports it as a broken picture. */
static pags_result read_begin(const char *path, uint8_t *bytes, size_t most, size_t *size) {
  pags_port_status status;
  if (!pags_port_stat(path, true, &status))
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));
  if (status.kind == PAGS_PORT_FOLDER)
    return pags_fail(PAGS_ERROR_IO, "%s: is a folder, expected a picture", path);
  if (status.kind != PAGS_PORT_FILE)
    return pags_fail(PAGS_ERROR_IO, "%s: expected a regular file", path);
  PAGS_AUTO(pags_file_close) FILE *file = pags_port_open(path, "rb");
  if (!file)
    return pags_fail(PAGS_ERROR_IO, "%s: %s", path, strerror(errno));
  *size = fread(bytes, 1, most, file);
  return ferror(file) ? pags_fail(PAGS_ERROR_IO, "%s: can't read", path) : PAGS_OK;
}

/* Reads the header of a PNG, JPEG or EXR file from its first bytes; where these are not enough, from the whole file. */
static pags_result inspect_known(const char *path, pags_image_facts *facts) {
  size_t size;
  pags_colour colour;
  PAGS_AUTOFREE uint8_t *begin = malloc(BEGIN);
  PAGS_CHECK_MEMORY(begin, "%s", path);
  PAGS_TRY(read_begin(path, begin, BEGIN, &size));
  const picture_format *const format = find_format(begin, size);
  if (!format)
    return refuse(path, begin, size);
  const pags_result result =
      format->inspect(&(pags_encoded){.path = path, .bytes = begin, .size = size}, facts, &colour);
  if (result == PAGS_OK || size < BEGIN)
    return result;
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  return format->inspect(&(pags_encoded){.path = path, .bytes = bytes, .size = size}, facts, &colour);
}

pags_result pags_image_inspect(const char *path, pags_image_facts *facts) {
  assert(path && facts);
  const pags_result result = inspect_known(path, facts);
  return result == PAGS_ERROR_UNSUPPORTED ? pags_other_inspect(path, facts) : result;
}

pags_result pags_image_size(const char *path, int *width, int *height) {
  pags_image_facts facts;
  assert(width && height);
  PAGS_TRY(pags_image_inspect(path, &facts));
  *width = facts.width;
  *height = facts.height;
  return PAGS_OK;
}

/* Decodes a PNG, JPEG or EXR file; `colour`, unless it is NULL, gets the space of its colours. */
static pags_result load_known(const char *path, int most, int rows, pags_image *out, pags_colour *colour) {
  PAGS_AUTOFREE uint8_t *bytes = NULL;
  uint8_t magic[MAGIC];
  size_t size;
  pags_image_facts facts;
  PAGS_TRY(read_begin(path, magic, sizeof magic, &size));
  const picture_format *const format = find_format(magic, size);
  if (!format)
    return refuse(path, magic, size);
  PAGS_TRY(pags_file_read(path, &bytes, &size));
  const pags_encoded file = {.path = path, .bytes = bytes, .size = size, .rows = rows};
  PAGS_TRY(format->decode(&file, most, out));
  return colour ? format->inspect(&file, &facts, colour) : PAGS_OK;
}

pags_result pags_image_load(const char *path, pags_sample sample, int channels, pags_image *out) {
  return pags_image_load_top(path, sample, channels, 0, out);
}

pags_result pags_image_load_top(const char *path, pags_sample sample, int channels, int rows, pags_image *out) {
  assert(path && out && channels >= 0 && channels <= 4);
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_colour ignored;
  memset(out, 0, sizeof *out);
  /* Channels that are not needed are not read. For one or two wanted channels up to four are: the luma of a colour
   * picture takes three, its alpha is the fourth. */
  const int most = channels == 3 ? 3 : 4;
  const pags_result result = load_known(path, most, rows, &image, NULL);
  PAGS_TRY(result == PAGS_ERROR_UNSUPPORTED ? pags_other_load(path, most, &image, &ignored) : result);
  PAGS_TRY(pags_image_convert(&image, sample, channels ? channels : image.channels));
  pags_image_move(&image, out);
  return PAGS_OK;
}

pags_result pags_image_load_display(const char *path, int channels, pags_image *out) {
  assert(path && out && (channels == 3 || channels == 4));
  PAGS_AUTO(pags_image_destroy) pags_image image = {0};
  pags_colour colour;
  memset(out, 0, sizeof *out);
  const pags_result result = load_known(path, channels, 0, &image, &colour);
  PAGS_TRY(result == PAGS_ERROR_UNSUPPORTED ? pags_other_load(path, channels, &image, &colour) : result);
  const bool shown = image.sample != PAGS_F32 && colour.kind == PAGS_COLOUR_SRGB;
  PAGS_TRY(pags_image_convert(&image, shown ? PAGS_U8 : image.sample, channels));
  PAGS_TRY(pags_colour_convert(&colour, path, &image));
  pags_image_move(&image, out);
  return PAGS_OK;
}

/* ---- Writing ---- */

enum { JPEG_QUALITY = 95 };

static pags_result encode_exr(const char *path, const pags_image *image, pags_sink *sink) {
  static const char *const grey[] = {"Y", "A"}, *const colour[] = {"R", "G", "B", "A"};
  const float *const data = image->data;
  const float *const planes[] = {data, data + 1, data + 2, data + 3};
  const pags_exr_planes picture = {.width = image->width,
                                   .height = image->height,
                                   .channels = image->channels,
                                   .names = image->channels <= 2 ? grey : colour,
                                   .planes = planes,
                                   .pixel_step = (size_t)image->channels,
                                   .row_step = (size_t)image->channels * (size_t)image->width};
  return pags_exr_encode(path, &picture, sink);
}

pags_result pags_image_save(const char *path, const pags_image *image) {
  assert(path && image && image->data);
  const char *const dot = pags_path_extension(path);
  const bool png = strcasecmp(dot, ".png") == 0, exr = strcasecmp(dot, ".exr") == 0;
  const bool jpeg = strcasecmp(dot, ".jpg") == 0 || strcasecmp(dot, ".jpeg") == 0;
  if (!png && !exr && !jpeg)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a name ending in .png, .jpg or .exr", path);
  const bool alpha = image->channels == 2 || image->channels == 4;
  const int channels = jpeg && alpha ? image->channels - 1 : image->channels;
  const pags_sample sample = exr ? PAGS_F32 : image->sample == PAGS_F32 || jpeg ? PAGS_U8 : image->sample;
  PAGS_AUTO(pags_image_destroy) pags_image copy = {0};
  PAGS_AUTO(pags_sink_destroy) pags_sink sink = {0};
  const bool same = sample == image->sample && channels == image->channels;
  if (!same)
    PAGS_TRY(pags_image_converted(image, sample, channels, &copy));
  const pags_image *const written = same ? image : &copy;
  PAGS_TRY(png   ? pags_png_encode(path, written, &sink)
           : exr ? encode_exr(path, written, &sink)
                 : pags_jpeg_encode(path, written, JPEG_QUALITY, &sink));
  pags_image_destroy(&copy);
  return pags_file_write_unsynced(path, sink.bytes, sink.size);
}

pags_result pags_image_save_exr(const char *path, int width, int height, int channels, const char *const *names,
                                const float *const *planes, int stride, const char *const *texts) {
  assert(path && names && planes && width >= 1 && width <= PAGS_IMAGE_MAX_SIDE && height >= 1 &&
         height <= PAGS_IMAGE_MAX_SIDE);
  assert(channels >= 1 && channels <= 64 && stride >= width);
  const pags_exr_planes picture = {.width = width,
                                   .height = height,
                                   .channels = channels,
                                   .names = names,
                                   .planes = planes,
                                   .pixel_step = 1,
                                   .row_step = (size_t)stride,
                                   .texts = texts};
  PAGS_AUTO(pags_sink_destroy) pags_sink sink = {0};
  PAGS_TRY(pags_exr_encode(path, &picture, &sink));
  return pags_file_write_unsynced(path, sink.bytes, sink.size);
}
