/* SPDX-License-Identifier: Apache-2.0 */
/* Writes SOG, version 2 (developer.playcanvas.com, "The SOG Format"; scene/sog.c lists what its pictures hold):
 * Gaussians in Morton order, so that neighbours in the pictures are alike, and lossless WebP. Scales, colours and the
 * palette of harmonics have a codebook of 256 values each. */
#include "exporters/format/splat_save.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <zlib.h>

#include "base/file.h"
#include "base/json.h"
#include "base/memory.h"
#include "base/zip.h"
#include "exporters/format/bake.h"
#include "exporters/format/palette.h"
#include "maths/maths.h"
#include "scene/axes.h"
#include "scene/webp.h"

enum { MOST_FILES = 8, PALETTE_ROW = 64, WEBP_SIDE = 16383 };

typedef struct packed_file {
  const char *name;
  uint8_t *bytes;
  size_t size;
} packed_file;

typedef struct sog_writer {
  const pags_gaussians *g;
  int64_t *order; /* row of the picture -> Gaussian */
  int width, height;
  uint8_t *pixels; /* of the picture that is being made */
  packed_file files[MOST_FILES];
  int file_count;
  pags_json_writer meta;
} sog_writer;

static void forget_writer(sog_writer *w) {
  for (int i = 0; i < w->file_count; i++)
    free(w->files[i].bytes);
  pags_json_writer_destroy(&w->meta);
  free(w->order);
  free(w->pixels);
}

/* Whether the path is that of the meta.json of a SOG in a folder. */
static bool is_meta(const char *path) {
  return strcasecmp(pags_path_name(path), "meta.json") == 0;
}

bool pags_sog_is_path(const char *path) {
  return strcasecmp(pags_path_extension(path), ".sog") == 0 || is_meta(path);
}

/* ---- Pictures ---- */

static pags_result add_picture(sog_writer *w, const char *name, const uint8_t *rgba, int width, int height) {
  packed_file *file = &w->files[w->file_count];
  PAGS_TRY(pags_webp_encode(rgba, width, height, &file->bytes, &file->size));
  file->name = name;
  w->file_count++;
  return PAGS_OK;
}

static double value_of(const sog_writer *w, int plane, int64_t row) {
  return (double)pags_plane(w->g, plane)[w->order[row]];
}

static double to_log(double x) {
  const double size = pags_log(fabs(x) + 1);
  return x < 0 ? -size : size;
}

/* Lists pictures and closes their object in meta.json. */
static void put_files(sog_writer *w, const char *const *names, int count) {
  pags_json_begin_array(&w->meta, "files");
  for (int i = 0; i < count; i++)
    pags_json_put_string(&w->meta, NULL, names[i]);
  pags_json_end_array(&w->meta);
  pags_json_end_object(&w->meta);
}

static pags_result put_means(sog_writer *w) {
  static const char *const names[2] = {"means_l.webp", "means_u.webp"};
  double lo[3], hi[3];
  for (int k = 0; k < 3; k++) {
    lo[k] = HUGE_VAL;
    hi[k] = -HUGE_VAL;
    for (int64_t i = 0; i < w->g->count; i++) {
      lo[k] = fmin(lo[k], to_log(value_of(w, PAGS_MEAN + k, i)));
      hi[k] = fmax(hi[k], to_log(value_of(w, PAGS_MEAN + k, i)));
    }
  }
  for (int half = 0; half < 2; half++) {
    for (int64_t i = 0; i < w->g->count; i++) {
      for (int k = 0; k < 3; k++) {
        const double share = hi[k] > lo[k] ? (to_log(value_of(w, PAGS_MEAN + k, i)) - lo[k]) / (hi[k] - lo[k]) : 0;
        w->pixels[4 * i + k] = (uint8_t)((int)floor(65535 * share + 0.5) >> 8 * half);
      }
      w->pixels[4 * i + 3] = 255;
    }
    PAGS_TRY(add_picture(w, names[half], w->pixels, w->width, w->height));
  }
  pags_json_begin_object(&w->meta, "means");
  pags_json_put_numbers(&w->meta, "mins", lo, 3);
  pags_json_put_numbers(&w->meta, "maxs", hi, 3);
  put_files(w, names, 2);
  return PAGS_OK;
}

static pags_result put_quats(sog_writer *w) {
  static const char *const names[1] = {"quats.webp"};
  for (int64_t i = 0; i < w->g->count; i++) {
    double q[4], length = 0;
    int largest = 0;
    for (int k = 0; k < 4; k++) {
      q[k] = value_of(w, PAGS_ROTATION + k, i);
      length += q[k] * q[k];
      largest = fabs(q[k]) > fabs(q[largest]) ? k : largest;
    }
    const double scale = length > 0 ? (q[largest] < 0 ? -1 : 1) / sqrt(length) : 0;
    for (int k = 0, to = 0; k < 4; k++)
      if (k != largest)
        w->pixels[4 * i + to++] = pags_splat_byte(127.5 * (q[k] * scale * 1.41421356237309505 + 1));
    w->pixels[4 * i + 3] = (uint8_t)(252 + largest);
  }
  pags_json_begin_object(&w->meta, "quats");
  put_files(w, names, 1);
  return add_picture(w, names[0], w->pixels, w->width, w->height);
}

/* Chooses and writes a codebook of `count` values; those of row i / width count as often as `members`, or NULL once,
 * says. */
static pags_result put_codebook(sog_writer *w, const float *values, int64_t count, const int32_t *members,
                                int64_t width, pags_codebook *book) {
  double lo = HUGE_VAL, hi = -HUGE_VAL, chosen[PAGS_CODEBOOK];
  for (int64_t i = 0; i < count; i++) {
    lo = fmin(lo, (double)values[i]);
    hi = fmax(hi, (double)values[i]);
  }
  PAGS_TRY(pags_codebook_create(book, lo, hi));
  for (int64_t i = 0; i < count; i++)
    pags_codebook_add(book, (double)values[i], members ? members[i / width] : 1);
  PAGS_TRY(pags_codebook_choose(book));
  for (int i = 0; i < PAGS_CODEBOOK; i++)
    chosen[i] = (double)book->values[i];
  pags_json_put_numbers(&w->meta, "codebook", chosen, PAGS_CODEBOOK);
  return PAGS_OK;
}

/* The values of `width` planes, row by row; freed by the caller. NULL if out of memory. */
static float *rows_of(const sog_writer *w, int plane, int width) {
  float *rows = malloc((size_t)w->g->count * (size_t)width * sizeof *rows);
  for (int64_t i = 0; rows && i < w->g->count; i++)
    for (int k = 0; k < width; k++)
      rows[i * width + k] = pags_plane(w->g, plane + k)[w->order[i]];
  return rows;
}

/* Writes three planes through one codebook. `opacity`: the fourth channel holds it; otherwise 255. */
static pags_result put_planes(sog_writer *w, const char *key, const char *name, int plane, bool opacity) {
  PAGS_AUTO(pags_codebook_destroy) pags_codebook book = {0};
  PAGS_AUTOFREE float *rows = rows_of(w, plane, 3);
  PAGS_CHECK_MEMORY(rows, "a codebook");
  pags_json_begin_object(&w->meta, key);
  PAGS_TRY(put_codebook(w, rows, 3 * w->g->count, NULL, 1, &book));
  put_files(w, &name, 1);
  for (int64_t i = 0; i < w->g->count; i++) {
    for (int k = 0; k < 3; k++)
      w->pixels[4 * i + k] = pags_codebook_index(&book, (double)rows[3 * i + k]);
    w->pixels[4 * i + 3] = opacity ? pags_splat_byte(255 / (1 + pags_exp(-value_of(w, PAGS_OPACITY, i)))) : 255;
  }
  return add_picture(w, name, w->pixels, w->width, w->height);
}

/* ---- Harmonics ---- */

static pags_result put_harmonics(sog_writer *w) {
  static const char *const names[2] = {"shN_centroids.webp", "shN_labels.webp"};
  const int terms = pags_sh_coefficients(w->g->sh_degree) - 1;
  const size_t width = 3 * (size_t)terms, count = (size_t)w->g->count;

  /* The palette has as many entries as splat-transform's, 1,024 to 65,536 by the count, and all of few Gaussians. */
  int64_t most = 1024, found;
  while (most < 65536 && 2 * most <= w->g->count)
    most *= 2;
  most = w->g->count < most ? w->g->count : most;
  PAGS_AUTOFREE float *rows = rows_of(w, PAGS_SH + 3, 3 * terms);
  PAGS_AUTOFREE float *entries = malloc((size_t)most * width * sizeof *entries);
  PAGS_AUTOFREE int32_t *labels = malloc(count * sizeof *labels);
  PAGS_AUTOFREE int32_t *members = calloc((size_t)most, sizeof *members);
  PAGS_CHECK_MEMORY(rows && entries && labels && members, "harmonics of %lld Gaussians", (long long)w->g->count);
  PAGS_TRY(pags_palette_make(rows, w->g->count, 3 * terms, most, entries, labels, &found));
  for (int64_t i = 0; i < w->g->count; i++)
    members[labels[i]]++;
  pags_json_begin_object(&w->meta, "shN");
  pags_json_put_integer(&w->meta, "count", found);
  pags_json_put_integer(&w->meta, "bands", w->g->sh_degree);
  /* The palette's picture, 64 entries a row, whose values are chosen by how many Gaussians have them. */
  const int across = PALETTE_ROW * terms, height = (int)((found + PALETTE_ROW - 1) / PALETTE_ROW);
  PAGS_AUTO(pags_codebook_destroy) pags_codebook book = {0};
  PAGS_AUTOFREE uint8_t *pixels = calloc((size_t)across * (size_t)height, 4);
  PAGS_CHECK_MEMORY(pixels, "a palette");
  PAGS_TRY(put_codebook(w, entries, found * 3 * terms, members, 3 * terms, &book));
  for (int64_t i = 0; i < found * terms; i++) {
    for (int c = 0; c < 3; c++)
      pixels[4 * i + c] = pags_codebook_index(&book, (double)entries[3 * i + c]);
    pixels[4 * i + 3] = 255;
  }
  PAGS_TRY(add_picture(w, names[0], pixels, across, height));
  put_files(w, names, 2);
  for (int64_t i = 0; i < w->g->count; i++)
    memcpy(w->pixels + 4 * i, (const uint8_t[4]){(uint8_t)labels[i], (uint8_t)(labels[i] >> 8), 0, 255}, 4);
  return add_picture(w, names[1], w->pixels, w->width, w->height);
}

/* ---- meta.json ---- */

static pags_result make_files(sog_writer *w, const pags_scene *scene) {
  pags_json_begin_object(&w->meta, NULL);
  pags_json_put_integer(&w->meta, "version", 2);
  pags_json_begin_object(&w->meta, "asset");
  pags_json_put_string(&w->meta, "generator", "pags " PAGS_VERSION_STRING);
  pags_json_put_numbers(&w->meta, "origin", scene->origin, 3);
  pags_json_put_string(&w->meta, "up", pags_up_code(scene->up));
  pags_json_end_object(&w->meta);
  pags_json_put_integer(&w->meta, "count", w->g->count);
  pags_json_put_bool(&w->meta, "antialias", scene->antialiased != 0);
  if (scene->antialiased)
    pags_json_put_string(&w->meta, "model", "antialiased");
  PAGS_TRY(put_means(w));
  PAGS_TRY(put_planes(w, "scales", "scales.webp", PAGS_SCALE, false));
  PAGS_TRY(put_quats(w));
  PAGS_TRY(put_planes(w, "sh0", "sh0.webp", PAGS_SH, true));
  if (w->g->sh_degree)
    PAGS_TRY(put_harmonics(w));
  pags_json_end_object(&w->meta);
  return pags_json_writer_finish(&w->meta);
}

/* ---- Folder and archive ---- */

static pags_result save_folder(const char *path, const sog_writer *w) {
  PAGS_AUTOFREE char *folder = pags_path_folder(path);
  PAGS_CHECK_MEMORY(folder, "%s: a path", path);
  PAGS_TRY(pags_make_dirs(folder));
  for (int i = 0; i < w->file_count; i++) {
    PAGS_AUTOFREE char *name = pags_path_join(folder, w->files[i].name);
    PAGS_CHECK_MEMORY(name, "%s: a path", path);
    PAGS_TRY(pags_file_write(name, w->files[i].bytes, w->files[i].size));
  }
  return pags_file_write(path, w->meta.data, w->meta.size);
}

/* Writes a zip archive of stored members. */
static pags_result save_archive(const char *path, const sog_writer *w) {
  uint8_t directory[(MOST_FILES + 1) * (PAGS_ZIP_CENTRAL + 64) + PAGS_ZIP_END], header[PAGS_ZIP_LOCAL + 64];
  packed_file files[MOST_FILES + 1] = {{"meta.json", (uint8_t *)w->meta.data, w->meta.size}};
  PAGS_AUTO(pags_file_writer_abort) pags_file_writer out = {0};
  size_t offset = 0, used = 0;
  uint64_t total = 0;
  memcpy(files + 1, w->files, sizeof w->files);
  for (int i = 0; i <= w->file_count; i++)
    total += files[i].size;
  if (total > 0xfff00000u)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: more than 4 GB, which a .sog can't have: write a folder, FOLDER/meta.json",
                     path);
  PAGS_TRY(pags_file_writer_begin(&out, path));
  for (int i = 0; i <= w->file_count; i++) {
    const pags_zip_item item = {.name = files[i].name,
                                .crc = (uint32_t)crc32(0, files[i].bytes, (uInt)files[i].size),
                                .size = (uint32_t)files[i].size,
                                .offset = (uint32_t)offset};
    const size_t length = pags_zip_put_local(header, &item);
    used += pags_zip_put_central(directory + used, &item);
    PAGS_TRY(pags_file_writer_put(&out, header, length));
    PAGS_TRY(pags_file_writer_put(&out, files[i].bytes, files[i].size));
    offset += length + files[i].size;
  }
  used += pags_zip_put_end(directory + used, w->file_count + 1, offset, used);
  PAGS_TRY(pags_file_writer_put(&out, directory, used));
  return pags_file_writer_commit(&out);
}

pags_result pags_sog_save(const char *path, const pags_scene *scene, const pags_gaussians *g) {
  PAGS_AUTO(forget_writer) sog_writer w = {.g = g};
  if (!g->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: there is no Gaussian at that time", path);
  w.width = 4 * (int)ceil(sqrt((double)g->count) / 4);
  w.height = 4 * (int)ceil((double)g->count / w.width / 4);
  if (w.width > WEBP_SIDE || w.height > WEBP_SIDE)
    return pags_fail(PAGS_ERROR_LIMIT, "%s: %lld Gaussians are too many for SOG", path, (long long)g->count);
  w.order = malloc((size_t)g->count * sizeof *w.order);
  w.pixels = calloc((size_t)w.width * (size_t)w.height, 4);
  PAGS_CHECK_MEMORY(w.order && w.pixels, "%lld Gaussians", (long long)g->count);
  PAGS_TRY(pags_gaussians_morton_order(g, w.order));
  PAGS_TRY(make_files(&w, scene));
  return is_meta(path) ? save_folder(path, &w) : save_archive(path, &w);
}
