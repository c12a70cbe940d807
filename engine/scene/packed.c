/* SPDX-License-Identifier: Apache-2.0 */
/* Packs Gaussians into quantised clusters (pags/packed.h, which has the bit layout), and writes, maps and checks
 * packed files (.pagsz): a header of 128 bytes, then the bounds of the clusters (seven planes of floats), the
 * geometry and the colours, each at a multiple of 64 bytes. */
#include <pags/packed.h>

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/bytes.h"
#include "base/file.h"
#include "base/half.h"
#include "base/memory.h"
#include "maths/maths.h"
#include "port/port.h"
#include "scene/packed_rows.h"

enum { ROWS = PAGS_PACKED_ROWS, HEAD = 128, ALIGNMENT = 64, BOUND_PLANES = 7, CHUNK = 4096 };
static const char magic[8] = {'P', 'A', 'G', 'S', 'P', 'K', '0', '1'};

/* Byte offsets of the three arrays in a file or memory block of packed Gaussians, and the size of the whole. */
typedef struct places {
  size_t bounds, geometry, colour, size;
} places;

static size_t align(size_t size) {
  return (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

static places find_places(int64_t clusters, int sh_degree) {
  places p = {.bounds = HEAD};
  p.geometry = align(p.bounds + (size_t)clusters * BOUND_PLANES * sizeof(float));
  p.colour = p.geometry + (size_t)clusters * PAGS_PACKED_GEOMETRY;
  p.size = p.colour + (size_t)clusters * pags_packed_colour_bytes(sh_degree);
  return p;
}

/* Makes `packed` a view of `bytes`, a block of the layout above with `count` Gaussians: sets its counts, its pointers
 * and its size. */
static void attach(pags_packed *packed, uint8_t *bytes, int64_t count, int sh_degree) {
  const int64_t clusters = (count + ROWS - 1) / ROWS;
  const places p = find_places(clusters, sh_degree);
  float *const bounds = (float *)(void *)(bytes + p.bounds);
  packed->shape = (pags_gaussians){.count = count, .sh_degree = sh_degree, .alpha_min = packed->shape.alpha_min};
  packed->clusters = (pags_clusters){.count = clusters, .size = ROWS};
  for (int k = 0; k < 3; k++) {
    packed->clusters.lo[k] = bounds + k * clusters;
    packed->clusters.hi[k] = bounds + (3 + k) * clusters;
  }
  packed->clusters.sigma = bounds + 6 * clusters;
  packed->geometry = bytes + p.geometry;
  packed->colour = bytes + p.colour;
  packed->block = bytes;
  packed->block_size = p.size;
}

/* ---- Packing ---- */

/* Returns the code 0..most of `value`: the nearest whole number of `step`s above `lowest`, clamped. */
static uint16_t quantise(float value, float lowest, float step, float most) {
  const float code = floorf((value - lowest) / step + 0.5f);
  return (uint16_t)(code > 0.0f ? code < most ? code : most : 0.0f); /* 0 for NaN */
}

/* Stores a 16-bit word of row `row` in plane `plane` of a cluster's block. */
static void put_word(uint8_t *block, int plane, int row, uint16_t word) {
  memcpy(block + 2 * ((size_t)plane * ROWS + (size_t)row), &word, sizeof word);
}

/* Packs the rotation of Gaussian `row` as row i of a cluster's block: the quaternion is normalised and its sign
 * chosen such that its largest component is positive; the other three are stored with 15 bits each, and the index of
 * the largest in the top bits of the first two. A zero quaternion is packed as the identity. */
static void pack_rotation(const pags_gaussians *g, int64_t row, int i, uint8_t *block) {
  double q[4], norm = 0;
  int largest = 0, place = 0;
  for (int k = 0; k < 4; k++) {
    q[k] = (double)pags_plane(g, PAGS_ROTATION + k)[row];
    norm += q[k] * q[k];
    largest = fabs(q[k]) > fabs(q[largest]) ? k : largest;
  }
  const double scale = norm > 0 ? (q[largest] < 0 ? -1 : 1) / sqrt(norm) : 0;
  for (int k = 0; k < 4; k++) {
    if (k == largest)
      continue;
    uint16_t word = quantise((float)(q[k] * scale), -PAGS_PACKED_HALF_ROOT, PAGS_PACKED_TURN, 32767.0f);
    if (place < 2 && (largest >> place & 1))
      word |= 0x8000;
    put_word(block, 6 + place++, i, word);
  }
}

/* Packs the colours of `rows` Gaussians from `first` on as one cluster's block: the constant SH coefficients as half
 * floats (clamped to the largest finite one), the others as int8 in steps of 1/127 of the largest of cluster and
 * plane. */
static void pack_colours(const pags_gaussians *g, int64_t first, int rows, uint8_t *block) {
  const int rest = 3 * (pags_sh_coefficients(g->sh_degree) - 1);
  uint8_t *const steps = block + pags_packed_steps_at(g->sh_degree);
  for (int c = 0; c < 3; c++)
    for (int i = 0; i < rows; i++) {
      const float v = pags_plane(g, PAGS_SH + c)[first + i];
      put_word(block, c, i, pags_half_from_float(v > 65504.0f ? 65504.0f : v < -65504.0f ? -65504.0f : v));
    }
  for (int p = 0; p < rest; p++) {
    const float *const values = pags_plane(g, PAGS_SH + 3 + p) + first;
    float most = 0.0f;
    for (int i = 0; i < rows; i++)
      most = fabsf(values[i]) > most ? fabsf(values[i]) : most;
    const float step = most / 127.0f;
    memcpy(steps + 4 * p, &step, sizeof step);
    for (int i = 0; i < rows; i++)
      block[(6 + p) * ROWS + i] = (uint8_t)(int8_t)(step > 0.0f ? (long)rintf(values[i] / step) : 0);
  }
}

pags_result pags_packed_create(const pags_gaussians *gaussians, pags_packed *out) {
  const int64_t clusters = (gaussians->count + ROWS - 1) / ROWS;
  const size_t size = find_places(clusters, gaussians->sh_degree).size;
  *out = (pags_packed){.shape.alpha_min = gaussians->alpha_min};
  uint8_t *const bytes = pags_port_aligned_alloc(ALIGNMENT, align(size));
  if (!bytes)
    return pags_out_of_memory("packing %lld Gaussians", (long long)gaussians->count);
  memset(bytes, 0, align(size));
  attach(out, bytes, gaussians->count, gaussians->sh_degree);
  out->has_s_sem = gaussians->s_sem != NULL;
  for (int64_t c = 0; c < clusters; c++) {
    const int64_t first = c * ROWS;
    const int rows = (int)(gaussians->count - first < ROWS ? gaussians->count - first : ROWS);

    uint8_t *block = bytes + (out->geometry - bytes) + c * PAGS_PACKED_GEOMETRY;

    /* Means: 16 bits between the bounds of the cluster on each axis. */
    for (int a = 0; a < 3; a++) {
      const float *const mean = pags_plane(gaussians, PAGS_MEAN + a) + first;
      float lo = mean[0], hi = mean[0];
      for (int i = 1; i < rows; i++) {
        lo = mean[i] < lo ? mean[i] : lo;
        hi = mean[i] > hi ? mean[i] : hi;
      }
      out->clusters.lo[a][c] = lo;
      out->clusters.hi[a][c] = hi;
      const float step = (hi - lo) * (1.0f / 65535.0f);
      for (int i = 0; i < rows; i++)
        put_word(block, a, i, step > 0.0f ? quantise(mean[i], lo, step, 65535.0f) : 0);
    }

    /* The logarithm of sigma, rotation, opacity logit and semantic priority. */
    for (int i = 0; i < rows; i++) {
      for (int k = 0; k < 3; k++)
        put_word(
            block, 3 + k, i,
            quantise(pags_plane(gaussians, PAGS_SCALE + k)[first + i], PAGS_PACKED_LOWEST, PAGS_PACKED_STEP, 65535.0f));
      pack_rotation(gaussians, first + i, i, block);
      put_word(
          block, 9, i,
          quantise(pags_plane(gaussians, PAGS_OPACITY)[first + i], PAGS_PACKED_LOWEST, PAGS_PACKED_STEP, 65535.0f));
      if (gaussians->s_sem)
        block[2 * PAGS_PACKED_WORDS * ROWS + i] =
            (uint8_t)(fminf(fmaxf(gaussians->s_sem[first + i], 0.0f), 1.0f) * 255.0f + 0.5f);
    }

    pack_colours(gaussians, first, rows,
                 bytes + (out->colour - bytes) + (size_t)c * pags_packed_colour_bytes(gaussians->sh_degree));

    /* The bound on sigma, from the unpacked values. One part in 1e5 is added because the exp of the projection kernel
     * rounds differently from that of libm. */
    float planes[PAGS_PACKED_GEOMETRY_PLANES * ROWS], largest = PAGS_PACKED_LOWEST;
    pags_packed_geometry(out, c, planes);
    for (int k = 0; k < 3; k++)
      for (int i = 0; i < rows; i++)
        largest = planes[(PAGS_SCALE + k) * ROWS + i] > largest ? planes[(PAGS_SCALE + k) * ROWS + i] : largest;
    out->clusters.sigma[c] = pags_expf(largest) * 1.00001f;
  }
  const pags_result result = pags_clusters_add_runs(&out->clusters);
  if (result != PAGS_OK)
    pags_packed_destroy(out);
  return result;
}

void pags_packed_destroy(pags_packed *packed) {
  pags_clusters_drop_runs(&packed->clusters);
  if (packed->mapped)
    pags_port_unmap(packed->block, packed->block_size);
  else
    pags_port_aligned_free(packed->block);
  *packed = (pags_packed){0};
}

size_t pags_packed_bytes(const pags_packed *packed) {
  return packed->block_size;
}

pags_result pags_packed_unpack(const pags_packed *packed, pags_gaussians *out) {
  float planes[PAGS_MAX_PLANES * ROWS];
  const int degree = packed->shape.sh_degree, plane_count = pags_plane_count(degree);
  PAGS_TRY(pags_gaussians_create(out, packed->shape.count, degree));
  out->alpha_min = packed->shape.alpha_min;
  if (packed->has_s_sem) {
    const pags_result result = pags_gaussians_add_s_sem(out);
    if (result != PAGS_OK) {
      pags_gaussians_destroy(out);
      return result;
    }
  }
  for (int64_t c = 0; c < packed->clusters.count; c++) {
    const int64_t first = c * ROWS;
    const int rows = (int)(out->count - first < ROWS ? out->count - first : ROWS);
    pags_packed_geometry(packed, c, planes);
    pags_packed_colours(packed, c, degree, planes + PAGS_SH * ROWS);
    for (int p = 0; p < plane_count; p++)
      memcpy(pags_plane(out, p) + first, planes + p * ROWS, (size_t)rows * sizeof(float));
    for (int i = 0; i < rows && out->s_sem; i++)
      out->s_sem[first + i] = pags_packed_s_sem(packed, first + i);
  }
  return PAGS_OK;
}

/* ---- Writing the file ---- */

/* Fills the header: magic (byte 0), count (8), SH degree (16), rows per cluster (17), whether it has s_sem (18), up
 * axis (19), antialiased (20), origin (24, three doubles), background (48, three floats), alpha_min (60); all other
 * bytes are 0. */
static void fill_head(const pags_packed *packed, int64_t count, uint8_t head[HEAD]) {
  memset(head, 0, HEAD);
  memcpy(head, magic, sizeof magic);
  memcpy(head + 8, &count, sizeof count);
  head[16] = (uint8_t)packed->shape.sh_degree;
  head[17] = ROWS;
  head[18] = packed->has_s_sem != 0;
  head[19] = (uint8_t)packed->up;
  head[20] = packed->antialiased != 0;
  memcpy(head + 24, packed->origin, sizeof packed->origin);
  memcpy(head + 48, packed->background, sizeof packed->background);
  memcpy(head + 60, &packed->shape.alpha_min, sizeof packed->shape.alpha_min);
}

/* Writes `count` zero bytes, at most 64. */
static pags_result put_zeros(pags_file_writer *file, size_t count) {
  static const uint8_t zeros[ALIGNMENT];
  return count ? pags_file_writer_put(file, zeros, count) : PAGS_OK;
}

/* Writes one plane of the clusters' bounds once per copy, each time moved by the copy's offset along `axis`; axis -1:
 * not moved. */
static pags_result put_bounds(pags_file_writer *file, const float *plane, int64_t clusters, int64_t copies, int axis,
                              const double *offsets) {
  float moved[CHUNK];
  for (int64_t c = 0; c < copies; c++)
    for (int64_t first = 0; first < clusters; first += CHUNK) {
      const int64_t rows = clusters - first < CHUNK ? clusters - first : CHUNK;
      for (int64_t i = 0; i < rows; i++)
        moved[i] = axis >= 0 && offsets ? (float)((double)plane[first + i] + offsets[3 * c + axis]) : plane[first + i];
      PAGS_TRY(pags_file_writer_put(file, moved, (size_t)rows * sizeof(float)));
    }
  return PAGS_OK;
}

pags_result pags_packed_save(const char *path, const pags_packed *packed, int64_t copies, const double *offsets) {
  const int64_t whole = packed->shape.count / ROWS;
  const int64_t clusters = copies > 1 ? whole : packed->clusters.count;
  const int64_t count = copies > 1 ? whole * ROWS * copies : packed->shape.count;
  pags_file_writer file;
  if (count > INT64_C(0x7FFFFFC0))
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %lld Gaussians are more than the 2^31 - 64 of a packed file", path,
                     (long long)count);
  PAGS_TRY(pags_file_writer_begin(&file, path));

  /* The header, the bounds (six planes of boxes, one of sigmas), the padding, the geometry, the colours. */
  uint8_t head[HEAD];
  const places p = find_places(clusters * copies, packed->shape.sh_degree);
  fill_head(packed, count, head);
  PAGS_TRY(pags_file_writer_put(&file, head, HEAD));
  for (int k = 0; k < 6; k++)
    PAGS_TRY(put_bounds(&file, k < 3 ? packed->clusters.lo[k] : packed->clusters.hi[k - 3], clusters, copies, k % 3,
                        offsets));
  PAGS_TRY(put_bounds(&file, packed->clusters.sigma, clusters, copies, -1, NULL));
  PAGS_TRY(put_zeros(&file, p.geometry - p.bounds - (size_t)(clusters * copies) * BOUND_PLANES * sizeof(float)));
  for (int64_t c = 0; c < copies; c++)
    PAGS_TRY(pags_file_writer_put(&file, packed->geometry, (size_t)clusters * PAGS_PACKED_GEOMETRY));
  for (int64_t c = 0; c < copies; c++)
    PAGS_TRY(pags_file_writer_put(&file, packed->colour,
                                  (size_t)clusters * pags_packed_colour_bytes(packed->shape.sh_degree)));

  return pags_file_writer_commit(&file);
}

pags_result pags_packed_export(const char *path, const pags_gaussians *gaussians, const pags_packed *head) {
  pags_gaussians sorted;
  pags_packed packed;
  PAGS_TRY(pags_gaussians_sorted_copy(&sorted, gaussians));
  pags_result result = pags_packed_create(&sorted, &packed);
  pags_gaussians_destroy(&sorted);
  PAGS_TRY(result);
  memcpy(packed.origin, head->origin, sizeof packed.origin);
  memcpy(packed.background, head->background, sizeof packed.background);
  packed.up = head->up;
  packed.antialiased = head->antialiased;
  result = pags_packed_save(path, &packed, 1, NULL);
  pags_packed_destroy(&packed);
  return result;
}

/* ---- Mapping the file ---- */

/* Fails unless the bounds of all clusters in the file are finite and in order. */
static pags_result check_bounds(const char *path, const pags_packed *packed) {
  const pags_clusters *const c = &packed->clusters;
  for (int64_t i = 0; i < c->count; i++) {
    bool good = c->sigma[i] >= 0.0f && c->sigma[i] < 1e7f; /* false for NaN */
    for (int k = 0; k < 3; k++)
      good = good && c->lo[k][i] <= c->hi[k][i] && fabsf(c->lo[k][i]) < 1e30f && fabsf(c->hi[k][i]) < 1e30f;
    if (!good)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: cluster %lld: expected finite bounds, lowest first", path, (long long)i);
  }
  return PAGS_OK;
}

/* Reads and checks the header and compares the file's size in bytes with the one it implies. */
static pags_result read_head(const char *path, const uint8_t *head, uint64_t size, int64_t *count, int *degree,
                             pags_packed *out) {
  memcpy(count, head + 8, sizeof *count);
  *degree = head[16];
  if (memcmp(head, magic, sizeof magic) != 0)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a packed splat file, which begins with 'PAGSPK01'", path);
  if (*count < 0 || *count > INT64_C(0x7FFFFFC0) || *degree > 3 || head[17] != ROWS || head[19] > PAGS_UP_Y)
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: head: expected at most 2^31 - 64 Gaussians of degree 0 to 3 in clusters of %d", path, ROWS);
  const places p = find_places((*count + ROWS - 1) / ROWS, *degree);
  if (p.size != size)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected %llu bytes for %lld Gaussians of degree %d, found %llu", path,
                     (unsigned long long)p.size, (long long)*count, *degree, (unsigned long long)size);
  out->has_s_sem = head[18];
  out->up = head[19];
  out->antialiased = head[20] != 0;
  memcpy(out->origin, head + 24, sizeof out->origin);
  memcpy(out->background, head + 48, sizeof out->background);
  memcpy(&out->shape.alpha_min, head + 60, sizeof out->shape.alpha_min);
  const float least = out->shape.alpha_min;
  if (least != 0.0f && !(least >= PAGS_LEAST_ALPHA_MIN && least < 1.0f))
    return pags_fail(PAGS_ERROR_FORMAT, "%s: head: expected a least alpha from 1/255 to 1", path);
  for (int k = 0; k < 3; k++)
    if (!isfinite(out->origin[k]) || !(out->background[k] >= 0.0f && out->background[k] <= 1.0f))
      return pags_fail(PAGS_ERROR_FORMAT, "%s: head: expected a finite origin and a background from 0 to 1", path);
  return PAGS_OK;
}

/* Maps a file of `size` bytes as a private copy-on-write mapping, so that the file itself is never written to. */
static pags_result map_file(const char *path, uint64_t size, uint8_t **bytes) {
  return pags_port_map(path, size, bytes) ? PAGS_OK : pags_fail(PAGS_ERROR_IO, "%s: can't be mapped into memory", path);
}

pags_result pags_packed_open(const char *path, pags_packed *out) {
  uint64_t size;
  uint8_t *bytes = NULL;
  int64_t count = 0;
  int degree = 0;
  *out = (pags_packed){0};
  PAGS_TRY(pags_file_size(path, &size));
  if (size < HEAD)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a head of %d bytes, found %llu", path, HEAD,
                     (unsigned long long)size);
  PAGS_TRY(map_file(path, size, &bytes));
  pags_result result = read_head(path, bytes, size, &count, &degree, out);
  if (result == PAGS_OK) {
    attach(out, bytes, count, degree);
    out->mapped = 1;
    result = check_bounds(path, out);
    if (result == PAGS_OK)
      result = pags_clusters_add_runs(&out->clusters);
  } else {
    pags_port_unmap(bytes, size);
  }
  if (result != PAGS_OK)
    pags_packed_destroy(out);
  return result;
}

int pags_packed_is_file(const char *path) {
  char start[sizeof magic];
  FILE *const file = pags_port_open(path, "rb");
  const bool is =
      file && fread(start, 1, sizeof start, file) == sizeof start && memcmp(start, magic, sizeof magic) == 0;
  if (file)
    fclose(file);
  return is;
}
