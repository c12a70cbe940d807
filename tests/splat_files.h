/* SPDX-License-Identifier: Apache-2.0 */
/* Small splat files of every format, made byte by byte without the library's writers, so that a mistake made by both
 * reader and writer doesn't go unnoticed. Functions abort if memory runs out. */
#ifndef PAGS_TESTS_SPLAT_FILES_H
#define PAGS_TESTS_SPLAT_FILES_H

#include <pags/gaussians.h>

typedef struct file_bytes {
  uint8_t *data;
  size_t size, capacity;
} file_bytes;

void bytes_put(file_bytes *bytes, const void *data, size_t size);
void bytes_text(file_bytes *bytes, const char *format, ...) PAGS_PRINTF(2, 3);
void bytes_u8(file_bytes *bytes, unsigned value);
void bytes_u32(file_bytes *bytes, uint32_t value);
void bytes_u64(file_bytes *bytes, uint64_t value);
void bytes_f32(file_bytes *bytes, float value);
void bytes_free(file_bytes *bytes);
/* Appends the data as stored blocks of a deflate stream. */
void bytes_stored(file_bytes *bytes, const void *data, size_t size);

/* Fills in random parameters of plausible size: means within 4 m, sigmas about 1 cm. */
void sample_gaussians(pags_gaussians *g, int64_t count, int sh_degree, uint64_t seed);

/* A PLY with its properties in INRIA's order. */
file_bytes make_ply(const pags_gaussians *g);
/* A PLY of the same values with its properties in another order and x y z as double. `format`: "ascii 1.0",
 * "binary_little_endian 1.0" or "binary_big_endian 1.0". */
file_bytes make_scrambled_ply(const pags_gaussians *g, const char *format);

/* A .splat file of random contents. */
file_bytes make_splat(int64_t count, uint64_t seed);
file_bytes make_compressed_ply(int64_t count, int sh_degree, int colour_bounds, uint64_t seed);

/* The contents of an SPZ file before compression. */
typedef struct spz_parts {
  int version, sh_degree, fractional_bits, flags;
  uint32_t count;
  file_bytes stream[6]; /* positions, opacities, colours, scales, rotations, SH */
} spz_parts;
spz_parts make_spz_parts(int version, uint32_t count, int sh_degree, uint64_t seed);
file_bytes pack_spz(const spz_parts *parts);  /* gzip for versions 2 and 3, zstd for version 4 */
file_bytes spz_plain(const spz_parts *parts); /* the bytes that gzip compresses */
void free_spz_parts(spz_parts *parts);

#endif
