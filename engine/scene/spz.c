/* SPDX-License-Identifier: Apache-2.0 */
/* Decodes Niantic's SPZ format, versions 2 to 4: attributes are quantised to bytes, stored one attribute after the
 * other and compressed.
 *
 * v2, v3  one gzip stream of a 16-byte header and the attributes
 * v4      an uncompressed 32-byte header, a table of (compressed, plain) sizes, one zstd frame per attribute
 *
 * The order is positions, opacities, colours, scales, rotations, SH. Extension records may follow: in versions 2 and 3
 * the attributes, in version 4 the header. The axes are OpenGL's (RUB: x right, y up, z back) unless the record of the
 * coordinate system, SPZ_ADOBE_coordinate_system, names others. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include <zstd.h>
#include <zstd_errors.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/vec3.h"
#include "scene/splat_formats.h"

enum { GZIP_HEADER = 16, V4_HEADER = 32, FLAG_ANTIALIASED = 1, FLAG_EXTENSIONS = 2, STREAMS = 6, SH_STREAM = 5 };

static const char *const stream_names[STREAMS] = {"positions", "opacities", "colours", "scales", "rotations", "SH"};

typedef struct spz_header {
  uint32_t version;
  int64_t count;
  int sh_degree; /* 0..4; coefficients of degree 4 are not read */
  int fractional_bits, flags;
  uint64_t sizes[STREAMS]; /* of each attribute's stream (means, opacities, ...) before compression, bytes */
  pags_splat_facts facts;  /* of the records */
} spz_header;

/* ---- Header and attributes ---- */

/* Parses and checks the first 16 bytes of the header, which are the same in all versions, and computes h->sizes. */
static pags_result read_header(const char *path, const uint8_t *bytes, spz_header *h) {
  if (memcmp(bytes, "NGSP", 4) != 0)
    return pags_fail_at(path, "expected 'NGSP' at the begin of the SPZ data");
  *h = (spz_header){.version = pags_load_u32(bytes + 4),
                    .count = pags_load_u32(bytes + 8),
                    .sh_degree = bytes[12],
                    .fractional_bits = bytes[13],
                    .flags = bytes[14]};
  if (h->version < 2 || h->version > 4)
    return pags_fail(PAGS_ERROR_UNSUPPORTED, "%s: SPZ version %u; versions 2 to 4 can be read", path, h->version);
  if (h->sh_degree > 4)
    return pags_fail_at(path, "byte 12: expected an SH degree of 0 to 4, found %d", h->sh_degree);
  if (h->fractional_bits > 24)
    return pags_fail_at(path, "byte 13: expected at most 24 fractional bits, found %d", h->fractional_bits);
  int bytes_each[STREAMS] = {9, 1, 3, 3, h->version == 2 ? 3 : 4, 3 * (pags_sh_coefficients(h->sh_degree) - 1)};
  for (int i = 0; i < STREAMS; i++)
    h->sizes[i] = (uint64_t)h->count * (uint64_t)bytes_each[i];
  return PAGS_OK;
}

static void decode_positions(const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  double step = ldexp(1.0, -h->fractional_bits);
  for (int64_t i = 0; i < out->count; i++)
    for (int k = 0; k < 3; ++k, bytes += 3) {
      int32_t fixed = bytes[0] | bytes[1] << 8 | bytes[2] << 16;
      fixed -= (fixed & 0x800000) << 1;
      pags_plane(out, PAGS_MEAN + k)[i] = (float)(step * fixed);
    }
}

static void decode_opacities(PAGS_UNUSED const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  for (int64_t i = 0; i < out->count; i++)
    pags_plane(out, PAGS_OPACITY)[i] = pags_logit_of_byte(bytes[i]);
}

static void decode_colours(PAGS_UNUSED const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  for (int64_t i = 0; i < out->count; i++)
    for (int k = 0; k < 3; k++)
      pags_plane(out, PAGS_SH + k)[i] = (float)((bytes[3 * i + k] / 255.0 - 0.5) / 0.15);
}

static void decode_scales(PAGS_UNUSED const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  for (int64_t i = 0; i < out->count; i++)
    for (int k = 0; k < 3; k++)
      pags_plane(out, PAGS_SCALE + k)[i] = (float)(bytes[3 * i + k] / 16.0 - 10.0);
}

static void decode_rotations(const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  for (int64_t i = 0; i < out->count; i++) {
    double q[4], sum = 0;  /* x, y, z, w */
    if (h->version == 2) { /* x, y and z are bytes over -1..1 */
      for (int k = 0; k < 3; k++) {
        q[k] = bytes[3 * i + k] / 127.5 - 1.0;
        sum += q[k] * q[k];
      }
      q[3] = sqrt(fmax(0, 1 - sum));
    } else {
      /* Versions 3 and 4: the top two bits are the index of the largest component. The other three have ten bits
       * each, the last one lowest: nine bits of magnitude, in units of 1/sqrt 2 / 511, and a sign. */
      uint32_t word = pags_load_u32(bytes + 4 * i);
      int largest = (int)(word >> 30);
      for (int k = 3; k >= 0; k--) {
        if (k == largest)
          continue;
        double magnitude = (word & 511) * (0.70710678118654752 / 511);
        q[k] = word & 512 ? -magnitude : magnitude;
        sum += magnitude * magnitude;
        word >>= 10;
      }
      q[largest] = sqrt(fmax(0, 1 - sum));
    }
    for (int k = 0; k < 4; k++)
      pags_plane(out, PAGS_ROTATION + (k + 1) % 4)[i] = (float)q[k];
  }
}

static void decode_sh(const spz_header *h, const uint8_t *bytes, pags_gaussians *out) {
  const int stride = 3 * (pags_sh_coefficients(h->sh_degree) - 1),
            used = 3 * (pags_sh_coefficients(out->sh_degree) - 1);
  for (int64_t i = 0; i < out->count; i++)
    for (int k = 0; k < used; k++)
      pags_plane(out, PAGS_SH + 3 + k)[i] = (float)((bytes[i * stride + k] - 128) / 128.0);
}

typedef void decode_fn(const spz_header *h, const uint8_t *bytes, pags_gaussians *out);
static decode_fn *const decoders[STREAMS] = {decode_positions, decode_opacities, decode_colours,
                                             decode_scales,    decode_rotations, decode_sh};

/* ---- Extension records ---- */

/* Takes PAGS' own record. */
static void read_scene_record(const char *path, const uint8_t *data, spz_header *h) {
  const uint32_t up = pags_load_u32(data);
  const double origin[3] = {pags_load_f64(data + 4), pags_load_f64(data + 12), pags_load_f64(data + 20)};
  if (up > PAGS_UP_Y || !isfinite(origin[0]) || !isfinite(origin[1]) || !isfinite(origin[2])) {
    PAGS_WARN("%s: the record of the origin and the up axis is damaged and left out", path);
    return;
  }
  h->facts.up = (pags_up)up;
  pags_copy3(origin, h->facts.origin);
}

/* Reads the records in `size` bytes: a type, a length and as many bytes each. The coordinate system and PAGS' own
 * (scene/splat_formats.h) are taken, others are skipped. */
static void read_records(const char *path, const uint8_t *bytes, size_t size, spz_header *h) {
  int64_t skipped = 0;
  uint32_t first = 0;
  while (size >= 8) {
    const uint32_t type = pags_load_u32(bytes), length = pags_load_u32(bytes + 4);
    if (length > size - 8) {
      PAGS_WARN(
          "%s: extension record %08X is damaged: expected at most %zu bytes, found %u; it and what follows are left "
          "out",
          path, type, size - 8, length);
      return;
    }
    if (type == PAGS_SPZ_AXES_RECORD && length == 4) {
      const uint32_t axes = pags_load_u32(bytes + 8);
      if (axes == 0 || axes >= PAGS_AXES_COUNT)
        PAGS_WARN("%s: the record of the coordinate system holds %u, expected 1 to 16: the axes are taken as RUB", path,
                  axes);
      else {
        h->facts.axes = (int)axes;
        h->facts.axes_from = "record";
      }
    } else if (type == PAGS_SPZ_SCENE_RECORD && length == PAGS_SPZ_SCENE_BYTES) {
      read_scene_record(path, bytes + 8, h);
    } else if (type == PAGS_SPZ_CUT_RECORD && length == 4) {
      h->facts.converted_from = pags_load_f32(bytes + 8);
    } else {
      first = skipped++ ? first : type;
    }
    bytes += 8 + length;
    size -= 8 + length;
  }
  if (skipped)
    pags_log_message(PAGS_LOG_INFO, "%s: %lld extension records are skipped, the first is %08X", path,
                     (long long)skipped, first);
}

/* ---- Versions 2 and 3: gzip ---- */

/* Returns the next larger capacity of a buffer for decompressed data, in bytes: at first (capacity 0) eight times the
 * `packed` bytes, which suffices for usual files, then twice as much each time, at most `size`. */
static uint64_t next_capacity(uint64_t capacity, uint64_t packed, uint64_t size) {
  uint64_t next = capacity ? 2 * capacity : 8 * packed + (1u << 16);
  return next < size ? next : size;
}

/* Inflates exactly `size` bytes to `out`; fails if the stream is damaged or ends before. */
static pags_result inflate_exactly(const char *path, z_stream *stream, uint8_t *out, uint64_t size) {
  while (size) {
    uInt step = size < 1u << 30 ? (uInt)size : 1u << 30;
    stream->next_out = out;
    stream->avail_out = step;
    int code = inflate(stream, Z_NO_FLUSH);
    uInt got = step - stream->avail_out;
    out += got;
    size -= got;
    PAGS_CHECK_MEMORY(code != Z_MEM_ERROR, "%s", path);
    if (size && (code != Z_OK || got == 0))
      return pags_fail_at(path, "byte %llu: the gzip data %s, %llu bytes before the end of the Gaussians",
                          (unsigned long long)stream->total_in, code == Z_DATA_ERROR ? "is damaged" : "ends",
                          (unsigned long long)size);
  }
  return PAGS_OK;
}

/* Inflates `size` bytes into a block that grows as data arrive, since `size` comes from the header, which may be
 * wrong, and must not cause a large allocation by itself. The caller frees *out, also on failure. */
static pags_result inflate_growing(const char *path, z_stream *stream, uint64_t file_size, uint64_t size,
                                   uint8_t **out) {
  uint64_t capacity = 0;
  for (uint64_t have = 0; have < size || !*out; have = capacity) {
    capacity = next_capacity(capacity, file_size, size);
    uint8_t *grown = realloc(*out, (size_t)capacity + 1);
    PAGS_CHECK_MEMORY(grown, "%s: %llu bytes", path, (unsigned long long)capacity);
    *out = grown;
    PAGS_TRY(inflate_exactly(path, stream, grown + have, capacity - have));
  }
  return PAGS_OK;
}

/* Inflates the rest after the attributes, up to the end of the stream, so that zlib verifies the checksum, and reads
 * the extension records there. At most 16 MiB may follow, so that a decompression bomb ends in an error; records are
 * looked for in the first 64 KiB. */
static pags_result inflate_rest(const char *path, z_stream *stream, spz_header *h) {
  enum { RECORDS = 1 << 16 };
  const bool extensions = h->flags & FLAG_EXTENSIONS;
  uint8_t scratch[4096];
  uint64_t extra = 0, limit = extensions ? 1u << 24 : 0;
  int code = Z_OK;
  PAGS_AUTOFREE uint8_t *records = extensions ? malloc(RECORDS) : NULL;
  PAGS_CHECK_MEMORY(records || !extensions, "%s: the records", path);
  while (code == Z_OK && extra <= limit) {
    stream->next_out = scratch;
    stream->avail_out = sizeof scratch;
    code = inflate(stream, Z_NO_FLUSH);
    const size_t got = sizeof scratch - stream->avail_out;
    if (records && extra < RECORDS)
      memcpy(records + extra, scratch, got < RECORDS - extra ? got : RECORDS - (size_t)extra);
    extra += got;
  }
  if (code != Z_STREAM_END || extra > limit)
    return pags_fail_at(path, "byte %llu: expected the end of the gzip data after the Gaussians",
                        (unsigned long long)stream->total_in);
  if (records)
    read_records(path, records, extra < RECORDS ? (size_t)extra : RECORDS, h);
  return PAGS_OK;
}

/* Decodes the gzip stream of versions 2 and 3; `file_size` is its compressed size in bytes. */
static pags_result decode_gzip(const char *path, z_stream *stream, size_t file_size, spz_header *h,
                               pags_gaussians *out) {
  uint8_t bytes[GZIP_HEADER];
  PAGS_TRY(inflate_exactly(path, stream, bytes, sizeof bytes));
  PAGS_TRY(read_header(path, bytes, h));
  if (h->version == 4)
    return pags_fail_at(path, "SPZ version 4 inside of gzip, which only versions 2 and 3 are");
  uint64_t total = 0;
  for (int i = 0; i < STREAMS; i++)
    total += h->sizes[i];
  /* Deflate compresses at most 1032 to 1: a count that would need more is refused before memory is allocated. */
  if (total / 1032 > file_size)
    return pags_fail_at(path, "%lld Gaussians can't be in %zu bytes", (long long)h->count, file_size);
  PAGS_AUTOFREE uint8_t *plain = NULL;
  PAGS_TRY(inflate_growing(path, stream, file_size, total, &plain));
  PAGS_TRY(inflate_rest(path, stream, h));
  PAGS_TRY(pags_splat_create(path, h->count, h->sh_degree, out));
  const uint8_t *at = plain;
  for (int i = 0; i < STREAMS; at += h->sizes[i++])
    decoders[i](h, at, out);
  return PAGS_OK;
}

static pags_result decode_legacy(const char *path, const uint8_t *bytes, size_t size, spz_header *h,
                                 pags_gaussians *out) {
  z_stream stream = {0};
  /* zlib counts input in 32 bits. 16 + MAX_WBITS makes it expect a gzip header. */
  if (size > UINT32_MAX)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: SPZ files of more than 4 GB can't be read", path);
  PAGS_CHECK_MEMORY(inflateInit2(&stream, 16 + MAX_WBITS) == Z_OK, "%s", path);
  stream.next_in = (z_const Bytef *)(uintptr_t)bytes;
  stream.avail_in = (uInt)size;
  pags_result result = decode_gzip(path, &stream, size, h, out);
  inflateEnd(&stream);
  return result;
}

/* ---- Version 4: zstd ---- */

/* Decompresses and decodes the zstd frame of one attribute of version 4, `packed` bytes at `bytes`, which lie at byte
 * `offset` of the file. The first attribute creates `out`. */
static pags_result decode_stream(const char *path, const spz_header *h, int index, const uint8_t *bytes,
                                 uint64_t packed, uint64_t offset, pags_gaussians *out) {
  const uint64_t size = h->sizes[index];
  uint64_t capacity = 0;
  PAGS_AUTOFREE uint8_t *plain = NULL;
  size_t got = 0;
  do { /* the size that the file gives may be wrong and must not cause a large allocation: start small and grow */
    free(plain);
    capacity = next_capacity(capacity, packed, size);
    plain = malloc((size_t)capacity + 1);
    PAGS_CHECK_MEMORY(plain, "%s: %llu bytes", path, (unsigned long long)capacity);
    got = ZSTD_decompress(plain, (size_t)capacity, bytes, (size_t)packed);
  } while (ZSTD_getErrorCode(got) == ZSTD_error_dstSize_tooSmall && capacity < size);
  PAGS_CHECK_MEMORY(ZSTD_getErrorCode(got) != ZSTD_error_memory_allocation, "%s", path);
  if (ZSTD_isError(got))
    return pags_fail_at(path, "byte %llu: the zstd data of the %s are damaged: %s", (unsigned long long)offset,
                        stream_names[index], ZSTD_getErrorName(got));
  if (got != size)
    return pags_fail_at(path, "byte %llu: expected %llu bytes of %s, found %zu", (unsigned long long)offset,
                        (unsigned long long)size, stream_names[index], got);
  if (index == 0) /* as many positions as the header gives Gaussians were there: allocate them now */
    PAGS_TRY(pags_splat_create(path, h->count, h->sh_degree, out));
  decoders[index](h, plain, out);
  return PAGS_OK;
}

/* Checks the table of sizes of version 4, before anything is allocated: the plain sizes must be those that the count
 * of Gaussians implies, and the compressed ones must fit into the file. */
static pags_result check_table(const char *path, const uint8_t *bytes, size_t size, const spz_header *h, uint64_t table,
                               int streams) {
  if (table < V4_HEADER || table > size || size - table < 16u * (unsigned)streams)
    return pags_fail_at(path, "byte 16: expected the table of streams within the file's %zu bytes, found %llu", size,
                        (unsigned long long)table);
  uint64_t offset = table + 16u * (unsigned)streams;
  for (int i = 0; i < streams; i++) {
    const uint8_t *entry = bytes + table + 16 * i;
    uint64_t packed = pags_load_u64(entry), plain = pags_load_u64(entry + 8);
    if (plain != h->sizes[i])
      return pags_fail_at(path, "byte %llu: expected %llu bytes of %s for %lld Gaussians, found %llu",
                          (unsigned long long)(table + 16u * (unsigned)i + 8), (unsigned long long)h->sizes[i],
                          stream_names[i], (long long)h->count, (unsigned long long)plain);
    /* A zstd block has at least three bytes and decompresses to at most 128 KiB. */
    if (packed > size - offset || plain / (1 << 17) * 3 > packed)
      return pags_fail_at(path, "truncated: expected the %s from byte %llu on, the file ends at byte %zu",
                          stream_names[i], (unsigned long long)offset, size);
    offset += packed;
  }
  return PAGS_OK;
}

static pags_result decode_v4(const char *path, const uint8_t *bytes, size_t size, spz_header *h, pags_gaussians *out) {
  if (size < V4_HEADER)
    return pags_fail_at(path, "truncated: expected a header of %d bytes, found %zu", V4_HEADER, size);
  PAGS_TRY(read_header(path, bytes, h));
  if (h->version != 4)
    return pags_fail_at(path,
                        "SPZ version %u without gzip, which only version 4 is: `gzip` makes it a file that can be read",
                        h->version);
  int streams = bytes[15], expected = h->sh_degree ? STREAMS : SH_STREAM;
  uint64_t table = pags_load_u32(bytes + 16);
  if (h->flags & FLAG_EXTENSIONS && table > V4_HEADER && table <= size)
    read_records(path, bytes + V4_HEADER, (size_t)table - V4_HEADER, h);
  if (h->count == 0)
    return pags_splat_create(path, 0, h->sh_degree, out); /* a file without Gaussians has no streams */
  if (streams != expected)
    return pags_fail_at(path, "byte 15: expected %d streams for SH degree %d, found %d", expected, h->sh_degree,
                        streams);
  PAGS_TRY(check_table(path, bytes, size, h, table, streams));
  uint64_t offset = table + 16u * (unsigned)streams;
  for (int i = 0; i < streams; i++) {
    uint64_t packed = pags_load_u64(bytes + table + 16 * i);
    PAGS_TRY(decode_stream(path, h, i, bytes + offset, packed, offset, out));
    offset += packed;
  }
  return PAGS_OK;
}

pags_result pags_spz_decode(const char *path, const uint8_t *bytes, size_t size, pags_gaussians *out,
                            pags_splat_facts *facts) {
  static const char *const kinds[] = {"SPZ v2", "SPZ v3", "SPZ v4"};
  spz_header h = {0};
  PAGS_TRY(size >= 2 && bytes[0] == 0x1f && bytes[1] == 0x8b ? decode_legacy(path, bytes, size, &h, out)
                                                             : decode_v4(path, bytes, size, &h, out));
  *facts = h.facts;
  facts->kind = kinds[h.version - 2];
  facts->antialiased = h.flags & FLAG_ANTIALIASED;
  if (facts->axes == PAGS_AXES_UNKNOWN) {
    facts->axes = PAGS_AXES_RUB;
    facts->axes_from = "specification";
  }
  return PAGS_OK;
}
