/* SPDX-License-Identifier: Apache-2.0 */
/* Small splat files of every format, made byte by byte and without the library's help, so that a reader that errs can't
 * agree with a writer that errs alike. Functions abort when memory is out. */
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
/* As blocks of a deflate stream that stores them. */
void bytes_stored(file_bytes *bytes, const void *data, size_t size);

/* Random parameters of plausible size: means within 4 m, sigmas about 1 cm. */
void sample_gaussians(pags_gaussians *g, int64_t count, int sh_degree, uint64_t seed);

/* A PLY in INRIA's order. */
file_bytes make_ply(const pags_gaussians *g);
/* The same numbers, the properties in another order; "ascii 1.0", "binary_little_endian 1.0" or
 * "binary_big_endian 1.0"; x y z as double. */
file_bytes make_scrambled_ply(const pags_gaussians *g, const char *format);

/* Random contents. */
file_bytes make_splat(int64_t count, uint64_t seed);
file_bytes make_compressed_ply(int64_t count, int sh_degree, int colour_bounds, uint64_t seed);

/* What an SPZ file says, before compression. */
typedef struct spz_parts {
  int version, sh_degree, fractional_bits, flags;
  uint32_t count;
  file_bytes stream[6]; /* positions, opacities, colours, scales, rotations, SH */
} spz_parts;
spz_parts make_spz_parts(int version, uint32_t count, int sh_degree, uint64_t seed);
file_bytes pack_spz(const spz_parts *parts);  /* gzip for versions 2 and 3, zstd for 4 */
file_bytes spz_plain(const spz_parts *parts); /* what gzip packs */
void free_spz_parts(spz_parts *parts);

#endif
