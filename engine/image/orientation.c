/* SPDX-License-Identifier: Apache-2.0 */
/* EXIF orientation: the value of tag 274 in the first directory of a TIFF structure, which a JPEG file has in a segment
 * APP1 that begins with "Exif" and two zeros. */
#include "image/orientation.h"

#include <assert.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

enum { TAG_ORIENTATION = 274, TYPE_SHORT = 3, TYPE_LONG = 4, ENTRY = 12 };
enum { APP1 = 0xe1, START_OF_SCAN = 0xda };

/* ---- Reading ---- */

static uint32_t load(const uint8_t *p, int count, bool big) {
  uint32_t value = 0;
  for (int i = 0; i < count; i++)
    value = value << 8 | p[big ? i : count - 1 - i];
  return value;
}

int pags_orientation_of_exif(const uint8_t *bytes, size_t size) {
  if (size < 8 || (memcmp(bytes, "II*\0", 4) != 0 && memcmp(bytes, "MM\0*", 4) != 0))
    return 1;
  const bool big = bytes[0] == 'M';
  const size_t directory = load(bytes + 4, 4, big);
  if (directory > size - 2)
    return 1;
  const size_t count = load(bytes + directory, 2, big), room = (size - directory - 2) / ENTRY;
  for (size_t i = 0; i < count && i < room; i++) {
    const uint8_t *const entry = bytes + directory + 2 + i * ENTRY;
    const uint32_t type = load(entry + 2, 2, big);
    if (load(entry, 2, big) != TAG_ORIENTATION || (type != TYPE_SHORT && type != TYPE_LONG))
      continue;
    const uint32_t value = load(entry + 8, type == TYPE_SHORT ? 2 : 4, big);
    return value >= 1 && value <= 8 ? (int)value : 1;
  }
  return 1;
}

int pags_orientation_of_jpeg(const uint8_t *bytes, size_t size) {
  for (size_t at = 2; at + 4 <= size && bytes[at] == 0xff && bytes[at + 1] != START_OF_SCAN;) {
    if (bytes[at + 1] == 0xff) { /* padding */
      at++;
      continue;
    }
    const size_t length = (size_t)bytes[at + 2] << 8 | bytes[at + 3], end = at + 2 + length;
    if (bytes[at + 1] == APP1 && length >= 8 && end <= size && memcmp(bytes + at + 4, "Exif\0\0", 6) == 0)
      return pags_orientation_of_exif(bytes + at + 10, length - 8);
    at = end;
  }
  return 1;
}

/* ---- Turning ---- */

static size_t pixel_bytes(const pags_image *image) {
  return (size_t)image->channels * (image->sample == PAGS_U8 ? 1 : image->sample == PAGS_U16 ? 2 : 4);
}

pags_result pags_image_turn(pags_image *image, int orientation) {
  assert(image->data && orientation >= 1 && orientation <= 8);
  if (orientation == 1)
    return PAGS_OK;
  const bool exchanged = orientation >= 5;
  const bool from_right = orientation == 2 || orientation == 3 || orientation == 7 || orientation == 8;
  const bool from_below = orientation == 3 || orientation == 4 || orientation == 6 || orientation == 7;
  pags_image out;
  PAGS_TRY(pags_image_create(&out, exchanged ? image->height : image->width, exchanged ? image->width : image->height,
                             image->channels, image->sample));
  const size_t bytes = pixel_bytes(image);
  uint8_t *to = out.data;
  for (int y = 0; y < out.height; y++)
    for (int x = 0; x < out.width; x++, to += bytes) {
      const int u = exchanged ? y : x, v = exchanged ? x : y; /* column and row in the file, before mirroring */
      const size_t column = (size_t)(from_right ? image->width - 1 - u : u);
      const size_t row = (size_t)(from_below ? image->height - 1 - v : v);
      memcpy(to, (const uint8_t *)image->data + (row * (size_t)image->width + column) * bytes, bytes);
    }
  pags_image_destroy(image);
  *image = out;
  return PAGS_OK;
}
