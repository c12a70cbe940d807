/* SPDX-License-Identifier: Apache-2.0 */
/* Packs the charts of all textures of a file into one picture: in rows, the highest first. If there is no room, all
 * charts become smaller by the same share. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/sort.h"
#include "exporters/proxy/texture.h"
#ifdef PAGS_WITH_IMAGES
#include "image/formats.h"
#endif

enum {
  BORDER = 2,  /* pixels by which a chart's border is continued */
  QUALITY = 92 /* of the JPEG file */
};

typedef struct piece {
  const pags_texture *texture;
  const pags_chart *chart;
  int64_t number;
  int x, y, width, height; /* its place in the picture, without the border */
} piece;

typedef struct row {
  int x, y; /* where its next piece begins */
} row;

static int compare_pieces(const void *left, const void *right) {
  const piece *a = left, *b = right;
  if (a->chart->height != b->chart->height)
    return a->chart->height > b->chart->height ? -1 : 1;
  if (a->chart->width != b->chart->width)
    return a->chart->width > b->chart->width ? -1 : 1;
  return a->number < b->number ? -1 : a->number > b->number;
}

void pags_atlas_destroy(pags_atlas *atlas) {
  free(atlas->jpeg);
  *atlas = (pags_atlas){0};
}

/* ---- Packing ---- */

/* Places pieces of `scale` times their size in rows of `width` pixels, each in the first row with room for it, since no
 * row is lower than the pieces that follow; returns the height of all. `rows` has room for one for each piece. */
static int64_t stack(piece *pieces, int64_t count, double scale, int width, row *rows) {
  int64_t y = 0, row_count = 0;
  for (piece *p = pieces; p < pieces + count; p++) {
    p->width = (int)ceil((p->chart->width - 1) * scale) + 1;
    p->height = (int)ceil((p->chart->height - 1) * scale) + 1;
    int64_t at = 0;
    while (at < row_count && rows[at].x + p->width + 2 * BORDER > width)
      at++;
    if (at == row_count) {
      if (y > INT32_MAX / 2)
        return y;
      rows[row_count++] = (row){.y = (int)y};
      y += p->height + 2 * BORDER;
    }
    p->x = rows[at].x + BORDER;
    p->y = rows[at].y + BORDER;
    rows[at].x += p->width + 2 * BORDER;
  }
  return y;
}

/* Finds the largest scale, at most 1, with which all pieces have room, and places them. False if no scale will do. */
static bool pack(piece *pieces, int64_t count, int side, row *rows, double *scale, pags_atlas *out) {
  for (*scale = 1; *scale > 1e-3; *scale *= 0.97) {
    double texels = 0;
    int widest = 0;
    for (const piece *p = pieces; p < pieces + count; p++) {
      texels += (*scale * p->chart->width + 2 * BORDER + 1) * (*scale * p->chart->height + 2 * BORDER + 1);
      widest = p->chart->width > widest ? p->chart->width : widest;
    }
    const double fair = fmax(ceil(sqrt(texels) / 64) * 64, ceil(*scale * widest) + 2 * BORDER + 1);
    if (texels > (double)side * side || fair > side)
      continue;
    out->width = (int)fair;
    const int64_t height = stack(pieces, count, *scale, out->width, rows);
    out->height = (int)height;
    if (height <= side)
      return true;
  }
  return false;
}

/* ---- Drawing ---- */

/* The colour of a chart around a point in its pixels, by a tent `1 / scale` pixels wide. */
static void look_up(const piece *p, double u, double v, double scale, uint8_t out[3]) {
  const pags_chart *chart = p->chart;
  double sum[3] = {0}, weights = 0;
  u = fmin(fmax(u, 0.5), chart->width - 0.5);
  v = fmin(fmax(v, 0.5), chart->height - 0.5);
  const int reach = (int)ceil(1 / scale), x0 = (int)u, y0 = (int)v;
  for (int y = y0 - reach > 0 ? y0 - reach : 0; y <= y0 + reach && y < chart->height; y++)
    for (int x = x0 - reach > 0 ? x0 - reach : 0; x <= x0 + reach && x < chart->width; x++) {
      const double weight = fmax(0, 1 - fabs(x + 0.5 - u) * scale) * fmax(0, 1 - fabs(y + 0.5 - v) * scale);
      const uint8_t *texel = p->texture->rgb + 3 * (chart->texel + (int64_t)y * chart->width + x);
      for (int c = 0; c < 3; c++)
        sum[c] += weight * texel[c];
      weights += weight;
    }
  for (int c = 0; c < 3; c++)
    out[c] = (uint8_t)(sum[c] / weights + 0.5);
}

static void draw(const piece *p, double scale, int width, uint8_t *rgb) {
  for (int y = -BORDER; y < p->height + BORDER; y++)
    for (int x = -BORDER; x < p->width + BORDER; x++)
      look_up(p, 0.5 + x / scale, 0.5 + y / scale, scale, rgb + 3 * ((int64_t)(p->y + y) * width + p->x + x));
}

static pags_result encode(uint8_t *rgb, pags_atlas *out) {
#ifdef PAGS_WITH_IMAGES
  pags_sink sink = {0};
  const pags_image image = {.width = out->width, .height = out->height, .channels = 3, .sample = PAGS_U8, .data = rgb};
  const pags_result result = pags_jpeg_encode("texture", &image, QUALITY, &sink);
  out->jpeg = sink.bytes;
  out->jpeg_size = sink.size;
  return result;
#else
  (void)rgb, (void)out;
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "--texture: this build has no pictures (CMake's PAGS_IMAGES)");
#endif
}

pags_result pags_atlas_make(pags_texture *const *textures, const int64_t *triangles, int64_t count, int side,
                            pags_atlas *out) {
  int64_t piece_count = 0;
  double scale = 1;
  for (int64_t i = 0; i < count; i++)
    piece_count += textures[i]->chart_count;
  if (!piece_count)
    return PAGS_OK;
  PAGS_AUTOFREE piece *pieces = malloc((size_t)piece_count * sizeof *pieces);
  PAGS_AUTOFREE row *rows = malloc((size_t)piece_count * sizeof *rows);
  PAGS_AUTOFREE piece **piece_of = malloc((size_t)piece_count * sizeof *piece_of);
  PAGS_CHECK_MEMORY(pieces && rows && piece_of, "%lld charts", (long long)piece_count);
  int64_t number = 0;
  for (int64_t i = 0; i < count; i++)
    for (int64_t c = 0; c < textures[i]->chart_count; c++, number++)
      pieces[number] = (piece){.texture = textures[i], .chart = &textures[i]->charts[c], .number = number};
  pags_sort(pieces, piece_count, sizeof *pieces, compare_pieces);
  if (!pack(pieces, piece_count, side, rows, &scale, out))
    return pags_fail(PAGS_ERROR_LIMIT, "--texture: %lld charts have no room in %dx%d pixels; give more",
                     (long long)piece_count, side, side);
  PAGS_AUTOFREE uint8_t *rgb = malloc(3 * (size_t)out->width * (size_t)out->height);
  PAGS_CHECK_MEMORY(rgb, "a texture of %dx%d pixels", out->width, out->height);
  memset(rgb, 128, 3 * (size_t)out->width * (size_t)out->height);
  for (int64_t i = 0; i < piece_count; i++) {
    draw(&pieces[i], scale, out->width, rgb);
    piece_of[pieces[i].number] = &pieces[i];
  }
  number = 0;
  for (int64_t i = 0; i < count; number += textures[i++]->chart_count) {
    pags_texture *t = textures[i];
    for (int64_t k = 0; t->uv && k < 6 * triangles[i]; k++) {
      const piece *p = piece_of[number + t->chart_of[k / 6]];
      const double at = (k % 2 ? p->y : p->x) + 0.5 + ((double)t->uv[k] - 0.5) * scale;
      t->uv[k] = (float)(at / (k % 2 ? out->height : out->width));
    }
    free(t->rgb);
    t->rgb = NULL;
  }
  return encode(rgb, out);
}
