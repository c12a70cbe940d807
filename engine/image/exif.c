/* SPDX-License-Identifier: Apache-2.0 */
/* EXIF: a TIFF structure (CIPA DC-008), which a JPEG file has in a segment APP1 that begins with "Exif" and two zeros.
 * Its first directory has the orientation; the colour space is in directories below. */
#include <string.h>

#include "image/formats.h"

enum {
  TAG_ORIENTATION = 274,
  TAG_EXIF = 0x8769,
  TAG_COLOUR_SPACE = 0xa001,
  TAG_INTEROPERABILITY = 0xa005,
  TAG_INDEX = 1
};
enum { TYPE_SHORT = 3, TYPE_LONG = 4, ENTRY = 12, ADOBE_RGB = 2 };
enum { APP1 = 0xe1, START_OF_SCAN = 0xda };

static uint32_t load(const uint8_t *p, int count, bool big) {
  uint32_t value = 0;
  for (int i = 0; i < count; i++)
    value = value << 8 | p[big ? i : count - 1 - i];
  return value;
}

/* An EXIF block: a TIFF structure. */
typedef struct exif {
  const uint8_t *bytes;
  size_t size;
  bool big; /* endian */
} exif;

static bool open_exif(const uint8_t *bytes, size_t size, exif *out) {
  if (size < 8 || (memcmp(bytes, "II*\0", 4) != 0 && memcmp(bytes, "MM\0*", 4) != 0))
    return false;
  *out = (exif){bytes, size, bytes[0] == 'M'};
  return true;
}

/* The entry of a tag in the directory at a byte; NULL: not found. */
static const uint8_t *find_entry(const exif *e, size_t directory, unsigned tag) {
  if (directory > e->size - 2)
    return NULL;
  const size_t count = load(e->bytes + directory, 2, e->big), room = (e->size - directory - 2) / ENTRY;
  for (size_t i = 0; i < count && i < room; i++)
    if (load(e->bytes + directory + 2 + i * ENTRY, 2, e->big) == tag)
      return e->bytes + directory + 2 + i * ENTRY;
  return NULL;
}

/* The number that an entry holds; 0 for other types. */
static uint32_t number_of(const exif *e, const uint8_t *entry) {
  const uint32_t type = load(entry + 2, 2, e->big);
  return type == TYPE_SHORT || type == TYPE_LONG ? load(entry + 8, type == TYPE_SHORT ? 2 : 4, e->big) : 0;
}

int pags_orientation_of_exif(const uint8_t *bytes, size_t size) {
  exif e;
  if (!open_exif(bytes, size, &e))
    return 1;
  const uint8_t *const entry = find_entry(&e, load(bytes + 4, 4, e.big), TAG_ORIENTATION);
  const uint32_t value = entry ? number_of(&e, entry) : 0;
  return value >= 1 && value <= 8 ? (int)value : 1;
}

bool pags_exif_says_adobe_rgb(const uint8_t *bytes, size_t size) {
  exif e;
  if (!open_exif(bytes, size, &e))
    return false;
  const uint8_t *const below = find_entry(&e, load(bytes + 4, 4, e.big), TAG_EXIF);
  const size_t directory = below ? number_of(&e, below) : 0;
  if (directory == 0)
    return false;
  const uint8_t *const space = find_entry(&e, directory, TAG_COLOUR_SPACE);
  if (space && number_of(&e, space) == ADOBE_RGB)
    return true;
  const uint8_t *const interoperability = find_entry(&e, directory, TAG_INTEROPERABILITY);
  const size_t last = interoperability ? number_of(&e, interoperability) : 0;
  const uint8_t *const index = last ? find_entry(&e, last, TAG_INDEX) : NULL;
  return index && memcmp(index + 8, "R03", 3) == 0;
}

const uint8_t *pags_jpeg_segment(const uint8_t *bytes, size_t size, size_t *at, size_t *length) {
  while (*at + 4 <= size && bytes[*at] == 0xff && bytes[*at + 1] == 0xff)
    ++*at; /* padding */
  if (*at + 4 > size || bytes[*at] != 0xff || bytes[*at + 1] == START_OF_SCAN)
    return NULL;
  const uint8_t *const segment = bytes + *at;
  *length = (size_t)segment[2] << 8 | segment[3];
  *at += 2 + *length;
  return segment;
}

const uint8_t *pags_exif_of_jpeg(const uint8_t *bytes, size_t size, size_t *exif_size) {
  const uint8_t *segment;
  size_t at = 2, length;
  while ((segment = pags_jpeg_segment(bytes, size, &at, &length))) {
    *exif_size = length - 8;
    if (segment[1] == APP1 && length >= 8 && at <= size && memcmp(segment + 4, "Exif\0\0", 6) == 0)
      return segment + 10;
  }
  return NULL;
}
