/* SPDX-License-Identifier: Apache-2.0 */
/* Loads and stores integers and floats as little-endian bytes at any address, aligned or not, on any machine.
 * Compilers turn each of these functions into a single load or store. */
#ifndef PAGS_BASE_BYTES_H
#define PAGS_BASE_BYTES_H

#include <stdint.h>
#include <string.h>

/* FNV-1a: the hash of some bytes after those that `hash` is of, PAGS_HASH_OF_NOTHING at first. */
#define PAGS_HASH_OF_NOTHING UINT64_C(14695981039346656037)
static inline uint64_t pags_hash_bytes(uint64_t hash, const void *bytes, size_t size) {
  const uint8_t *b = bytes;
  for (size_t i = 0; i < size; i++)
    hash = (hash ^ b[i]) * UINT64_C(1099511628211);
  return hash;
}

static inline uint16_t pags_load_u16(const uint8_t *p) {
  return (uint16_t)(p[0] | p[1] << 8);
}

static inline uint32_t pags_load_u32(const uint8_t *p) {
  return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static inline uint64_t pags_load_u64(const uint8_t *p) {
  return (uint64_t)pags_load_u32(p) | (uint64_t)pags_load_u32(p + 4) << 32;
}

static inline float pags_load_f32(const uint8_t *p) {
  uint32_t bits = pags_load_u32(p);
  float value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

static inline double pags_load_f64(const uint8_t *p) {
  uint64_t bits = pags_load_u64(p);
  double value;
  memcpy(&value, &bits, sizeof value);
  return value;
}

/* A big-endian number of up to four bytes. */
static inline uint32_t pags_load_big(const uint8_t *p, int bytes) {
  uint32_t value = 0;
  for (int i = 0; i < bytes; i++)
    value = value << 8 | p[i];
  return value;
}

static inline void pags_store_u32(uint8_t *p, uint32_t value) {
  p[0] = (uint8_t)value;
  p[1] = (uint8_t)(value >> 8);
  p[2] = (uint8_t)(value >> 16);
  p[3] = (uint8_t)(value >> 24);
}

static inline void pags_store_u64(uint8_t *p, uint64_t value) {
  pags_store_u32(p, (uint32_t)value);
  pags_store_u32(p + 4, (uint32_t)(value >> 32));
}

static inline void pags_store_f32(uint8_t *p, float value) {
  uint32_t bits;
  memcpy(&bits, &value, sizeof bits);
  pags_store_u32(p, bits);
}

static inline void pags_store_f64(uint8_t *p, double value) {
  uint64_t bits;
  memcpy(&bits, &value, sizeof bits);
  pags_store_u64(p, bits);
}

/* Writes at most three bytes as four characters of base64 (RFC 4648). */
static inline void pags_base64_three(const uint8_t *bytes, size_t size, char four[4]) {
  static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const uint32_t word =
      (uint32_t)bytes[0] << 16 | (size > 1 ? (uint32_t)bytes[1] << 8 : 0) | (size > 2 ? (uint32_t)bytes[2] : 0);
  four[0] = digits[word >> 18];
  four[1] = digits[word >> 12 & 63];
  four[2] = size > 1 ? digits[word >> 6 & 63] : '=';
  four[3] = size > 2 ? digits[word & 63] : '=';
}

#endif
