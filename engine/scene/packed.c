/* SPDX-License-Identifier: Apache-2.0 */
/* Packs Gaussians into quantised clusters (pags/packed.h, which has the bit layout), and writes, maps and checks
 * packed files (.pagsz): a header of 128 bytes, then the bounds of the clusters (seven planes of floats), the
 * geometry and the colours, and, in files of version 02, the clusters with whole rows and these rows, each at a
 * multiple of 64 bytes. */
#include <pags/packed.h>

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/half.h"
#include "base/log.h"
#include "base/memory.h"
#include "maths/maths.h"
#include "port/port.h"
#include "scene/packed_rows.h"

enum { ROWS = PAGS_PACKED_ROWS, HEAD = 128, ALIGNMENT = 64, BOUND_PLANES = 7, CHUNK = 4096 };
static const char magic[2][8] = {"PAGSPK01", "PAGSPK02"}; /* without and with whole rows */

/* Byte offsets of the arrays in a file or memory block of packed Gaussians, and the size of it all. */
typedef struct places {
  size_t bounds, geometry, colour, mixed, whole, size;
} places;

static size_t align(size_t size) {
  return (size + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

/* By the counts and the SH degree of `packed`. */
static places find_places(const pags_packed *packed) {
  const size_t clusters = (size_t)packed->clusters.count;
  places p = {.bounds = HEAD};
  p.geometry = align(p.bounds + clusters * BOUND_PLANES * sizeof(float));
  p.colour = p.geometry + clusters * PAGS_PACKED_GEOMETRY;
  p.mixed = p.colour + clusters * pags_packed_colour_bytes(packed->shape.sh_degree);
  p.whole = align(p.mixed + (size_t)packed->mixed_count * sizeof(pags_packed_mixed));
  p.size = p.whole + (size_t)packed->whole_count * pags_packed_whole_bytes(packed->shape.sh_degree);
  return p;
}

/* Makes `packed`, whose counts and SH degree are set, a view of `bytes`, a block of the layout above. */
static void attach(pags_packed *packed, uint8_t *bytes) {
  const int64_t clusters = packed->clusters.count;
  const places p = find_places(packed);
  float *const bounds = (float *)(void *)(bytes + p.bounds);
  packed->clusters.size = ROWS;
  for (int k = 0; k < 3; k++) {
    packed->clusters.lo[k] = bounds + k * clusters;
    packed->clusters.hi[k] = bounds + (3 + k) * clusters;
  }
  packed->clusters.sigma = bounds + 6 * clusters;
  packed->geometry = bytes + p.geometry;
  packed->colour = bytes + p.colour;
  packed->mixed = (const pags_packed_mixed *)(const void *)(bytes + p.mixed);
  packed->whole = bytes + p.whole;
  packed->block = bytes;
  packed->block_size = p.size;
}

/* ---- Packing ---- */

/* Returns the code 0..most of `value`: the nearest whole number of `step`s above `lowest`, clamped. */
static uint16_t quantise(float value, float lowest, float step, float most) {
  const float code = floorf((value - lowest) / step + 0.5f);
  return (uint16_t)(code > 0.0f ? code < most ? code : most : 0.0f); /* 0 for NaN */
}

/* The byte of the block of a struct that is being packed, at which one of its arrays lies. */
static uint8_t *writable(const pags_packed *out, const void *at) {
  return (uint8_t *)out->block + ((const uint8_t *)at - (const uint8_t *)out->block);
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
 * plane. `whole`: rows that don't count. */
static void pack_colours(const pags_gaussians *g, int64_t first, int rows, uint64_t whole, uint8_t *block) {
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
      most = fabsf(values[i]) > most && !(whole >> i & 1) ? fabsf(values[i]) : most;
    const float step = most / 127.0f;
    memcpy(steps + 4 * p, &step, sizeof step);
    for (int i = 0; i < rows; i++)
      block[(6 + p) * ROWS + i] =
          (uint8_t)(int8_t)(step > 0.0f && !(whole >> i & 1) ? (long)rintf(values[i] / step) : 0);
  }
}

/* Packs the means of a cluster: 16 bits between the bounds of those rows that aren't whole. Sets the bounds of all. */
static void pack_means(const pags_gaussians *g, int64_t first, int rows, uint64_t whole, int64_t cluster,
                       pags_packed *out, float box[2][3], uint8_t *block) {
  for (int a = 0; a < 3; a++) {
    const float *const mean = pags_plane(g, PAGS_MEAN + a) + first;
    float lo = INFINITY, hi = -INFINITY, least = mean[0], most = mean[0];
    for (int i = 0; i < rows; i++) {
      least = mean[i] < least ? mean[i] : least;
      most = mean[i] > most ? mean[i] : most;
      if (whole >> i & 1)
        continue;
      lo = mean[i] < lo ? mean[i] : lo;
      hi = mean[i] > hi ? mean[i] : hi;
    }
    out->clusters.lo[a][cluster] = least;
    out->clusters.hi[a][cluster] = most;
    box[0][a] = lo <= hi ? lo : least; /* all rows may be whole */
    box[1][a] = lo <= hi ? hi : least;
    const float step = (box[1][a] - box[0][a]) * (1.0f / 65535.0f);
    for (int i = 0; i < rows; i++)
      put_word(block, a, i, step > 0.0f && !(whole >> i & 1) ? quantise(mean[i], lo, step, 65535.0f) : 0);
  }
}

/* Appends a cluster's whole rows, and the cluster, to the lists. ln sigma and the logit are clamped, and zero
 * quaternions the identity, as those of others are. */
static void put_whole(const pags_gaussians *g, int64_t first, int rows, uint64_t whole, int64_t cluster,
                      float box[2][3], pags_packed *out) {
  const size_t bytes = pags_packed_whole_bytes(g->sh_degree);
  pags_packed_mixed mixed = {.cluster = (uint32_t)cluster, .first = (uint32_t)out->whole_count};
  memcpy(mixed.lo, box[0], sizeof mixed.lo);
  memcpy(mixed.hi, box[1], sizeof mixed.hi);
  memcpy(writable(out, out->mixed + out->mixed_count++), &mixed, sizeof mixed);
  for (int i = 0; i < rows; i++) {
    if (!(whole >> i & 1))
      continue;
    uint8_t *const at = writable(out, out->whole + (size_t)out->whole_count++ * bytes);
    const uint32_t row = (uint32_t)i;
    memcpy(at, &row, sizeof row);
    float values[PAGS_MAX_PLANES];
    for (int p = 0; p < pags_plane_count(g->sh_degree); p++) {
      values[p] = pags_plane(g, p)[first + i];
      if ((p >= PAGS_SCALE && p < PAGS_ROTATION) || p == PAGS_OPACITY)
        values[p] = fminf(fmaxf(values[p], PAGS_PACKED_LOWEST), -PAGS_PACKED_LOWEST);
    }
    float *const q = values + PAGS_ROTATION;
    q[0] = q[0] == 0 && q[1] == 0 && q[2] == 0 && q[3] == 0 ? 1.0f : q[0];
    memcpy(at + sizeof row, values, bytes - sizeof row);
  }
}

/* Packs the rows of one cluster. */
static void pack_cluster(const pags_gaussians *g, int64_t c, uint64_t whole, pags_packed *out) {
  const int64_t first = c * ROWS;
  const int rows = (int)(g->count - first < ROWS ? g->count - first : ROWS);
  uint8_t *const block = writable(out, out->geometry + c * PAGS_PACKED_GEOMETRY);
  float box[2][3];
  pack_means(g, first, rows, whole, c, out, box, block);

  /* The logarithm of sigma, rotation, opacity logit and semantic priority. */
  for (int i = 0; i < rows; i++) {
    for (int k = 0; k < 4; k++) {
      const float value = pags_plane(g, k < 3 ? PAGS_SCALE + k : PAGS_OPACITY)[first + i];
      put_word(block, k < 3 ? 3 + k : 9, i, quantise(value, PAGS_PACKED_LOWEST, PAGS_PACKED_STEP, 65535.0f));
    }
    pack_rotation(g, first + i, i, block);
    if (g->s_sem)
      block[2 * PAGS_PACKED_WORDS * ROWS + i] =
          (uint8_t)(fminf(fmaxf(g->s_sem[first + i], 0.0f), 1.0f) * 255.0f + 0.5f);
  }

  pack_colours(g, first, rows, whole, writable(out, out->colour + (size_t)c * pags_packed_colour_bytes(g->sh_degree)));
  if (whole)
    put_whole(g, first, rows, whole, c, box, out);

  /* The bound on sigma, from the unpacked values. One part in 1e5 is added because the exp of the projection kernel
   * rounds differently from that of libm. */
  float planes[PAGS_PACKED_GEOMETRY_PLANES * ROWS], largest = PAGS_PACKED_LOWEST;
  pags_packed_geometry(out, c, planes);
  for (int k = 0; k < 3; k++)
    for (int i = 0; i < rows; i++)
      largest = planes[(PAGS_SCALE + k) * ROWS + i] > largest ? planes[(PAGS_SCALE + k) * ROWS + i] : largest;
  out->clusters.sigma[c] = pags_expf(largest) * 1.00001f;
}

pags_result pags_packed_create(const pags_gaussians *gaussians, pags_packed *out) {
  const int64_t count = gaussians->count, clusters = (count + ROWS - 1) / ROWS;
  PAGS_AUTO(pags_packed_destroy)
  pags_packed packed = {.shape = {.count = count, .sh_degree = gaussians->sh_degree, .alpha_min = gaussians->alpha_min},
                        .clusters.count = clusters,
                        .has_s_sem = gaussians->s_sem != NULL};
  *out = (pags_packed){0};
  PAGS_AUTOFREE uint64_t *whole = malloc((size_t)(clusters + 1) * sizeof *whole); /* bit i of a cluster's: its row i */
  PAGS_CHECK_MEMORY(whole, "packing %lld Gaussians", (long long)count);
  for (int64_t c = 0; c < clusters; c++) {
    const int64_t left = count - c * ROWS;
    whole[c] = pags_packed_choose_whole(gaussians, c * ROWS, left < ROWS ? (int)left : ROWS);
    packed.mixed_count += whole[c] != 0;
    packed.whole_count += __builtin_popcountll(whole[c]);
  }
  const size_t size = align(find_places(&packed).size);
  uint8_t *const bytes = pags_port_aligned_alloc(ALIGNMENT, size);
  PAGS_CHECK_MEMORY(bytes, "packing %lld Gaussians", (long long)count);
  memset(bytes, 0, size);
  attach(&packed, bytes);
  packed.mixed_count = packed.whole_count = 0;
  for (int64_t c = 0; c < clusters; c++)
    pack_cluster(gaussians, c, whole[c], &packed);
  PAGS_TRY(pags_clusters_add_runs(&packed.clusters));
  *out = packed;
  packed = (pags_packed){0};
  return PAGS_OK;
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
  const pags_result result = packed->has_s_sem ? pags_gaussians_add_s_sem(out) : PAGS_OK;
  if (result != PAGS_OK) {
    pags_gaussians_destroy(out);
    return result;
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

/* Fills the header, of zeros: magic (byte 0), count (8), SH degree (16), rows per cluster (17), whether it has s_sem
 * (18), up axis (19), antialiased (20), origin (24, three doubles), background (48, three floats), alpha_min (60),
 * numbers of clusters with whole rows (64) and of whole rows (72); all other bytes are 0. */
static void fill_head(const pags_packed *packed, uint8_t head[HEAD]) {
  memcpy(head, magic[packed->mixed_count > 0], sizeof *magic);
  memcpy(head + 8, &packed->shape.count, sizeof packed->shape.count);
  memcpy(head + 64, &packed->mixed_count, sizeof packed->mixed_count);
  memcpy(head + 72, &packed->whole_count, sizeof packed->whole_count);
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

/* Moves the packed floats of three axes by an offset. */
static void move(uint8_t *floats, const double *offset) {
  float x[3];
  memcpy(x, floats, sizeof x);
  for (int k = 0; k < 3 && offset; k++)
    x[k] = (float)((double)x[k] + offset[k]);
  memcpy(floats, x, sizeof x);
}

/* Writes the lists of the clusters with whole rows and of these rows, once per copy. */
static pags_result put_lists(pags_file_writer *file, const pags_packed *one, int64_t copies, const double *offsets) {
  const size_t bytes = pags_packed_whole_bytes(one->shape.sh_degree);
  uint8_t row[sizeof(uint32_t) + PAGS_MAX_PLANES * sizeof(float)];
  for (int64_t c = 0; c < copies; c++)
    for (int64_t m = 0; m < one->mixed_count; m++) {
      pags_packed_mixed mixed = one->mixed[m];
      mixed.cluster += (uint32_t)(c * one->clusters.count);
      mixed.first += (uint32_t)(c * one->whole_count);
      move((uint8_t *)mixed.lo, offsets ? offsets + 3 * c : NULL);
      move((uint8_t *)mixed.hi, offsets ? offsets + 3 * c : NULL);
      PAGS_TRY(pags_file_writer_put(file, &mixed, sizeof mixed));
    }
  const size_t written = (size_t)(copies * one->mixed_count) * sizeof(pags_packed_mixed);
  PAGS_TRY(put_zeros(file, align(written) - written));
  for (int64_t c = 0; c < copies; c++)
    for (int64_t i = 0; i < one->whole_count; i++) {
      memcpy(row, one->whole + (size_t)i * bytes, bytes);
      move(row + sizeof(uint32_t), offsets ? offsets + 3 * c : NULL);
      PAGS_TRY(pags_file_writer_put(file, row, bytes));
    }
  return PAGS_OK;
}

pags_result pags_packed_save(const char *path, const pags_packed *packed, int64_t copies, const double *offsets) {
  pags_packed one = *packed;
  if (copies > 1) { /* whole clusters alone */
    one.clusters.count = one.shape.count / ROWS;
    one.shape.count = one.clusters.count * ROWS;
    if (one.mixed_count && one.mixed[one.mixed_count - 1].cluster >= one.clusters.count)
      one.whole_count = one.mixed[--one.mixed_count].first;
  }
  pags_packed all = one;
  all.shape.count *= copies;
  all.clusters.count *= copies;
  all.mixed_count *= copies;
  all.whole_count *= copies;
  pags_file_writer file;
  if (all.shape.count > INT64_C(0x7FFFFFC0))
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %lld Gaussians are more than the 2^31 - 64 of a packed file", path,
                     (long long)all.shape.count);
  for (int k = 0; k < 3; k++)
    if (!isfinite(packed->origin[k]) || !isfinite(packed->background[k]))
      return pags_fail(PAGS_ERROR_ARGUMENT, "%s: expected a finite origin and background, found %g and %g", path,
                       packed->origin[k], (double)packed->background[k]);
  PAGS_TRY(pags_file_writer_begin(&file, path));

  /* The header, the bounds (six planes of boxes, one of sigmas), the padding, the geometry, the colours, the lists. */
  uint8_t head[HEAD] = {0};
  const places p = find_places(&all);
  fill_head(&all, head);
  PAGS_TRY(pags_file_writer_put(&file, head, HEAD));
  for (int k = 0; k < 6; k++)
    PAGS_TRY(put_bounds(&file, k < 3 ? packed->clusters.lo[k] : packed->clusters.hi[k - 3], one.clusters.count, copies,
                        k % 3, offsets));
  PAGS_TRY(put_bounds(&file, packed->clusters.sigma, one.clusters.count, copies, -1, NULL));
  PAGS_TRY(put_zeros(&file, p.geometry - p.bounds - (size_t)all.clusters.count * BOUND_PLANES * sizeof(float)));
  for (int64_t c = 0; c < copies; c++)
    PAGS_TRY(pags_file_writer_put(&file, packed->geometry, (size_t)one.clusters.count * PAGS_PACKED_GEOMETRY));
  for (int64_t c = 0; c < copies; c++)
    PAGS_TRY(pags_file_writer_put(&file, packed->colour,
                                  (size_t)one.clusters.count * pags_packed_colour_bytes(one.shape.sh_degree)));
  PAGS_TRY(put_lists(&file, &one, copies, offsets));
  return pags_file_writer_commit(&file);
}

/* Fails at a value that isn't finite; logs the number of Gaussians whose sigma or colour is clamped. */
static pags_result check_range(const char *path, const pags_gaussians *g) {
  int64_t clamped = 0;
  for (int64_t i = 0; i < g->count; i++) {
    bool beyond = false;
    for (int p = 0; p < pags_plane_count(g->sh_degree); p++) {
      const float value = pags_plane(g, p)[i];
      if (!isfinite(value))
        return pags_fail(PAGS_ERROR_ARGUMENT, "%s: Gaussian %lld: expected finite numbers, found %g", path,
                         (long long)i, (double)value);
      beyond = beyond || (p >= PAGS_SCALE && p < PAGS_ROTATION && value > -PAGS_PACKED_LOWEST) ||
               (p >= PAGS_SH && p < PAGS_SH + 3 && fabsf(value) > 65504.0f);
    }
    clamped += beyond;
  }
  if (clamped)
    PAGS_WARN("%s: %lld Gaussians have a sigma over 8.9e6 m or a colour over 18,000, which are clamped", path,
              (long long)clamped);
  return PAGS_OK;
}

pags_result pags_packed_export(const char *path, const pags_gaussians *gaussians, const pags_packed *head) {
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians sorted = {0};
  PAGS_AUTO(pags_packed_destroy) pags_packed packed = {0};
  PAGS_TRY(check_range(path, gaussians));
  PAGS_TRY(pags_gaussians_sorted_copy(&sorted, gaussians));
  PAGS_TRY(pags_packed_create(&sorted, &packed));
  memcpy(packed.origin, head->origin, sizeof packed.origin);
  memcpy(packed.background, head->background, sizeof packed.background);
  packed.up = head->up;
  packed.antialiased = head->antialiased;
  return pags_packed_save(path, &packed, 1, NULL);
}

/* ---- Mapping the file ---- */

/* Fails unless the bounds of all clusters in the file are finite and in order, and means between them, too. */
static pags_result check_bounds(const char *path, const pags_packed *packed) {
  const pags_clusters *const c = &packed->clusters;
  for (int64_t i = 0; i < c->count; i++) {
    bool good = c->sigma[i] >= 0.0f && c->sigma[i] < 1e7f; /* false for NaN */
    int64_t count;
    const bool mixed = packed->mixed_count && pags_packed_find_mixed(packed, i, &count); /* has a box of its own */
    for (int k = 0; k < 3; k++)
      good = good && c->lo[k][i] <= c->hi[k][i] && isfinite(c->lo[k][i]) && isfinite(c->hi[k][i]) &&
             (mixed || isfinite(c->hi[k][i] - c->lo[k][i]));
    if (!good)
      return pags_fail_at(path, "cluster %lld: expected finite bounds, lowest first", (long long)i);
  }
  return PAGS_OK;
}

/* Reads and checks the header and compares the file's size in bytes with the one it implies. */
static pags_result read_head(const char *path, const uint8_t *head, uint64_t size, pags_packed *out) {
  const bool second = memcmp(head, magic[1], sizeof *magic) == 0;
  if (!second && memcmp(head, magic[0], sizeof *magic) != 0)
    return pags_fail_at(path, "expected a packed splat file, which begins with 'PAGSPK01' or 'PAGSPK02'");
  int64_t count;
  memcpy(&count, head + 8, sizeof count);
  if (second) {
    memcpy(&out->mixed_count, head + 64, sizeof out->mixed_count);
    memcpy(&out->whole_count, head + 72, sizeof out->whole_count);
  }
  if (count < 0 || count > INT64_C(0x7FFFFFC0) || head[16] > 3 || head[17] != ROWS || head[19] > PAGS_UP_Y)
    return pags_fail_at(path, "head: expected at most 2^31 - 64 Gaussians of degree 0 to 3 in clusters of %d", ROWS);
  const int64_t clusters = (count + ROWS - 1) / ROWS;
  if (out->mixed_count < 0 || out->mixed_count > clusters || out->whole_count < out->mixed_count ||
      out->whole_count > count)
    return pags_fail_at(path, "head: expected at most %lld clusters with whole rows, and at most %lld of these",
                        (long long)clusters, (long long)count);
  out->shape = (pags_gaussians){.count = count, .sh_degree = head[16]};
  out->clusters.count = clusters;
  const size_t expected = find_places(out).size;
  if (expected != size)
    return pags_fail_at(path, "expected %zu bytes for %lld Gaussians of degree %d, found %llu", expected,
                        (long long)count, head[16], (unsigned long long)size);
  out->has_s_sem = head[18];
  out->up = head[19];
  out->antialiased = head[20] != 0;
  memcpy(out->origin, head + 24, sizeof out->origin);
  memcpy(out->background, head + 48, sizeof out->background);
  memcpy(&out->shape.alpha_min, head + 60, sizeof out->shape.alpha_min);
  const float least = out->shape.alpha_min;
  if (least != 0.0f && !(least >= PAGS_LEAST_ALPHA_MIN && least < 1.0f))
    return pags_fail_at(path, "head: expected a least alpha from 1/255 to 1");
  for (int k = 0; k < 3; k++)
    if (!isfinite(out->origin[k]) || !isfinite(out->background[k]))
      return pags_fail_at(path, "head: expected a finite origin and background");
  return PAGS_OK;
}

pags_result pags_packed_open(const char *path, pags_packed *out) {
  uint64_t size;
  uint8_t *bytes = NULL;
  *out = (pags_packed){0};
  PAGS_TRY(pags_file_size(path, &size));
  if (size < HEAD)
    return pags_fail_at(path, "expected a head of %d bytes, found %llu", HEAD, (unsigned long long)size);
  /* A private copy-on-write mapping, so that the file itself is never written to. */
  if (!pags_port_map(path, size, &bytes))
    return pags_fail(PAGS_ERROR_IO, "%s: can't be mapped into memory", path);
  PAGS_AUTO(pags_packed_destroy) pags_packed packed = {.block = bytes, .block_size = size, .mapped = 1};
  PAGS_TRY(read_head(path, bytes, size, &packed));
  attach(&packed, bytes);
  PAGS_TRY(check_bounds(path, &packed));
  PAGS_TRY(pags_packed_check_whole(path, &packed));
  PAGS_TRY(pags_clusters_add_runs(&packed.clusters));
  *out = packed;
  packed = (pags_packed){0};
  return PAGS_OK;
}

int pags_packed_is_file(const char *path) {
  char start[sizeof *magic];
  return pags_file_head(path, start, sizeof start) == sizeof start &&
         (memcmp(start, magic[0], sizeof start) == 0 || memcmp(start, magic[1], sizeof start) == 0);
}
