/* SPDX-License-Identifier: Apache-2.0 */
/* Colour spaces in containers (other.h): WebP's chunk ICCP (RFC 9649), and the box colr of JPEG 2000 (ISO/IEC
 * 15444-1, I.5.3.3) and HEIF (ISO/IEC 23008-12, 6.5.5). */
#include "base/bytes.h"
#include "image/other.h"

static bool find_in_webp(const uint8_t *bytes, size_t size, pags_colour *colour) {
  for (size_t at = 12; at + 8 <= size;) {
    const uint8_t *const chunk = bytes + at;
    const size_t length = pags_load_u32(chunk + 4);
    if (length > size - at - 8)
      return false;
    if (memcmp(chunk, "ICCP", 4) == 0) {
      pags_colour_set_icc(colour, chunk + 8, length);
      return true;
    }
    at += 8 + length + length % 2;
  }
  return false;
}

/* Reads a box colr: a profile, or numbers of H.273. In JPEG 2000, whose method is a number, 1 names sRGB, grey or sYCC,
 * which all are sRGB. */
static bool read_colr(const uint8_t *box, size_t size, pags_colour *colour) {
  const bool named = size >= 4 && (memcmp(box, "prof", 4) == 0 || memcmp(box, "rICC", 4) == 0);
  const bool numbers = size >= 10 && memcmp(box, "nclx", 4) == 0;
  const size_t head = named ? 4 : 3; /* bytes before a profile */
  if (numbers)                       /* the decoder has seen to matrix and range */
    pags_colour_set_cicp(colour, (int)pags_load_big(box + 4, 2), (int)pags_load_big(box + 6, 2), true);
  else if (named || (size > 3 && (box[0] == 2 || box[0] == 3)))
    pags_colour_set_icc(colour, box + head, size - head);
  else
    return false;
  return true;
}

/* Looks through the boxes [at, end) and those within; a profile counts more than numbers, and the first of a kind. */
static bool find_in_boxes(const uint8_t *bytes, size_t at, size_t end, int depth, pags_colour *colour) {
  static const char *const outer[] = {"jp2h", "meta", "iprp", "ipco"};
  bool found = false;
  while (at + 8 <= end) {
    const uint8_t *const box = bytes + at;
    size_t length = pags_load_big(box, 4), head = 8;
    if (length == 1 && at + 16 <= end) {
      length = pags_load_big(box + 8, 4) ? end - at : pags_load_big(box + 12, 4);
      head = 16;
    }
    if (length == 0 || length > end - at)
      length = end - at;
    if (length < head)
      return found;
    if (memcmp(box + 4, "colr", 4) == 0 && (!found || memcmp(box + head, "nclx", length - head < 4 ? 0 : 4) != 0))
      found = read_colr(box + head, length - head, colour) || found;
    for (size_t i = 0; i < sizeof outer / sizeof *outer && depth < 4 && !found; i++)
      if (memcmp(box + 4, outer[i], 4) == 0)
        found = find_in_boxes(bytes, at + head + (i == 1 ? 4 : 0), at + length, depth + 1, colour);
    at += length;
  }
  return found;
}

bool pags_container_colour(const uint8_t *bytes, size_t size, pags_colour *colour) {
  if (size < 12)
    return false;
  if (memcmp(bytes, "RIFF", 4) == 0 && memcmp(bytes + 8, "WEBP", 4) == 0)
    return find_in_webp(bytes, size, colour);
  if (memcmp(bytes + 4, "ftyp", 4) == 0 || memcmp(bytes + 4, "jP  ", 4) == 0)
    return find_in_boxes(bytes, 0, size, 0, colour);
  return false;
}
