/* SPDX-License-Identifier: Apache-2.0 */
/* Base64 (RFC 4648). */
#ifndef PAGS_BASE_BASE64_H
#define PAGS_BASE_BASE64_H

#include <stddef.h>
#include <stdint.h>

/* Writes at most three bytes as four characters. */
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
