/* SPDX-License-Identifier: Apache-2.0 */
/* How names become numbers in a Cryptomatte: MurmurHash3 for 32-bit results (Austin Appleby, public domain) and the
 * specification's conversion to a float (Psyop, Cryptomatte Specification 1.2.0). */
#include <pags/passes.h>

#include <string.h>

#include "base/bytes.h"

static uint32_t rotate(uint32_t x, int by) {
  return x << by | x >> (32 - by);
}

static uint32_t scramble(uint32_t word) {
  return rotate(word * UINT32_C(0xcc9e2d51), 15) * UINT32_C(0x1b873593);
}

uint32_t pags_cryptomatte_hash(const char *name, size_t length) {
  uint32_t hash = 0;
  for (size_t i = 0; i < length / 4; i++)
    hash = rotate(hash ^ scramble(pags_load_u32((const uint8_t *)name + 4 * i)), 13) * 5 + UINT32_C(0xe6546b64);
  uint8_t rest[4] = {0};
  memcpy(rest, name + length / 4 * 4, length % 4);
  hash ^= scramble(pags_load_u32(rest)); /* 0 where nothing is left */
  hash ^= (uint32_t)length;
  hash = (hash ^ hash >> 16) * UINT32_C(0x85ebca6b);
  hash = (hash ^ hash >> 13) * UINT32_C(0xc2b2ae35);
  return hash ^ hash >> 16;
}

float pags_cryptomatte_value(uint32_t hash) {
  const uint32_t exponent = hash >> 23 & 255, kept = exponent < 1 ? 1 : exponent > 254 ? 254 : exponent;
  const uint32_t bits = (hash & ~(UINT32_C(255) << 23)) | kept << 23;
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}
