/* SPDX-License-Identifier: Apache-2.0 */
/* Finds and loads the mask pictures and label images of a view: FOLDER/TTT_C.png, where TTT is the number of the frame
 * and C that of the camera. */
#include "dataset/driving/masks.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/memory.h"
#include "base/text.h"

pags_result pags_driving_find_mask(const pags_driving *driving, const char *folder, const pags_parsed_view *view,
                                   char **out) {
  PAGS_AUTOFREE char *path =
      pags_text_format("%s/%s/%0*d_%d.png", driving->root, folder, driving->digits, view->frame, view->sensor);
  PAGS_CHECK_MEMORY(path, "%s", driving->root);
  *out = pags_file_exists(path) ? pags_take(&path) : NULL;
  return PAGS_OK;
}

static pags_result check_size(const char *path, const pags_lens *lens, int width, int height) {
  if (width == lens->width && height == lens->height)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_FORMAT, "%s: %d x %d pixels, expected %d x %d as its photograph has", path, width, height,
                   lens->width, lens->height);
}

pags_result pags_driving_load_mask(const char *path, const pags_lens *lens, pags_image *out) {
  PAGS_TRY(pags_image_load(path, PAGS_U8, 1, out));
  return check_size(path, lens, out->width, out->height);
}

pags_result pags_driving_load_mask_top(const char *path, const pags_lens *lens, int rows, pags_image *out) {
  int width, height;
  PAGS_TRY(pags_image_size(path, &width, &height));
  PAGS_TRY(check_size(path, lens, width, height));
  return pags_image_load_top(path, PAGS_U8, 1, rows, out);
}

uint8_t pags_driving_white(const pags_image *mask) {
  const uint8_t *from = mask->data;
  const size_t count = (size_t)mask->width * (size_t)mask->height;
  unsigned all = 0; /* every bit that some pixel has */
  for (size_t i = 0; i < count; i++)
    all |= from[i];
  return all == 1 ? 1 : 128;
}

/* ---- Label images ---- */

/* Reads the depth of the samples (1 to 16) and the type of colour of a PNG (ISO/IEC 15948, 11.2.2: bytes 24 and 25);
 * zeros for another file. */
static void read_form(const char *path, int *depth, int *type) {
  uint8_t head[26];
  const size_t got = pags_file_head(path, head, sizeof head);
  const bool png = got == sizeof head && memcmp(head, "\x89PNG", 4) == 0;
  *depth = png ? head[24] : 0;
  *type = png ? head[25] : 0;
}

bool pags_driving_has_colours(const char *path) {
  int depth, type;
  read_form(path, &depth, &type);
  return type & 2; /* RGB, a palette, RGBA */
}

/* Makes the 16-bit samples of a label image 8 bits wide, without scaling them. */
static pags_result narrow(const char *path, pags_image *image) {
  const uint16_t *from = image->data;
  const size_t count = (size_t)image->width * (size_t)image->height;
  pags_image narrowed;
  PAGS_TRY(pags_image_create(&narrowed, image->width, image->height, 1, PAGS_U8));
  uint8_t *to = narrowed.data;
  unsigned most = 0;
  for (size_t i = 0; i < count; i++) {
    most = from[i] > most ? from[i] : most;
    to[i] = (uint8_t)from[i];
  }
  pags_image_destroy(image);
  *image = narrowed;
  if (most <= 255)
    return PAGS_OK;
  return pags_fail(PAGS_ERROR_FORMAT,
                   "%s: values up to %u, expected ids of classes up to 255; ids of instances (class x 1000 + number) "
                   "are to be divided",
                   path, most);
}

/* Keeps the first of the channels of a label image, which must be equal but for alpha. */
static pags_result keep_one(const char *path, pags_image *image) {
  const size_t count = (size_t)image->width * (size_t)image->height, step = (size_t)image->channels;
  uint8_t *data = image->data;
  for (size_t i = 0; i < count; i++) {
    const uint8_t *pixel = data + i * step;
    if (step >= 3 && (pixel[0] != pixel[1] || pixel[0] != pixel[2]))
      return pags_fail(PAGS_ERROR_FORMAT,
                       "%s: the pixel at %d, %d has the colour %d %d %d, expected the id of its class as one number (a "
                       "grey PNG of 8 bits); colours and palettes have to be turned into ids first",
                       path, (int)(i % (size_t)image->width), (int)(i / (size_t)image->width), pixel[0], pixel[1],
                       pixel[2]);
    data[i] = pixel[0];
  }
  image->channels = 1;
  return PAGS_OK;
}

pags_result pags_driving_load_labels(const char *path, const pags_lens *lens, pags_image *out) {
  int depth, type;
  read_form(path, &depth, &type);
  const bool wide = depth == 16;
  PAGS_TRY(pags_image_load(path, wide ? PAGS_U16 : PAGS_U8, wide ? 1 : 0, out));
  PAGS_TRY(check_size(path, lens, out->width, out->height));
  return wide ? narrow(path, out) : out->channels > 1 ? keep_one(path, out) : PAGS_OK;
}
