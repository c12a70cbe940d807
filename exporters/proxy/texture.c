/* SPDX-License-Identifier: Apache-2.0 */
/* Bakes base-colour textures. The texture is a lattice of square cells, two triangles each, divided by the cell's
 * diagonal: no chart needs to be packed, and any mesh has a texture, at the price of a seam along every edge. Texels
 * beyond a triangle's edge get the colour of the nearest point on it, so that filtering doesn't show the neighbour. */
#include "exporters/proxy/texture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/tsdf.h"
#ifdef PAGS_WITH_IMAGES
#include "image/formats.h"
#endif

enum { LEAST_CELL = 5 }; /* pixels: the legs of either triangle are two */

typedef struct lattice {
  int cells; /* a side */
  int cell;  /* pixels a side */
} lattice;

/* The point of the mesh that a texel shows. Returns false where the cell has no triangle. */
static bool point_of(const pags_proxy_mesh *mesh, const lattice *l, int x, int y, double out[3]) {
  const int u = x % l->cell, v = y % l->cell;
  const bool second = u + v >= l->cell - 1;
  const int64_t triangle = 2 * ((int64_t)(y / l->cell) * l->cells + x / l->cell) + second;
  if (triangle >= mesh->triangle_count)
    return false;
  const double leg = l->cell - 3;
  double b = fmin((second ? l->cell - 1 - u : u) / leg, 1), c = fmin((second ? l->cell - 1 - v : v) / leg, 1);
  if (b + c > 1) { /* beyond the long edge: the nearest point on it */
    const double over = 0.5 * (b + c - 1);
    b = fmax(0, fmin(b - over, 1));
    c = 1 - b;
  }
  double p[3][3];
  pags_proxy_mesh_corners(mesh, triangle, p);
  for (int k = 0; k < 3; k++)
    out[k] = (1 - b - c) * p[0][k] + b * p[1][k] + c * p[2][k];
  return true;
}

/* Paints a cloud of one vertex a texel, and makes a picture of it. */
static pags_result paint(const pags_proxy_mesh *mesh, const lattice *l, const pags_depth_views *depth_views,
                         double tolerance, pags_tasks *tasks, uint8_t *rgb) {
  static const float grey[3] = {0.5f, 0.5f, 0.5f};
  const int side = l->cells * l->cell;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh texels = {0};
  double point[3];
  float narrow[3];
  for (int y = 0; y < side; y++)
    for (int x = 0; x < side; x++)
      if (point_of(mesh, l, x, y, point)) {
        pags_narrow3(point, narrow);
        pags_proxy_mesh_vertex(&texels, narrow, grey, 1);
      }
  PAGS_TRY(pags_proxy_mesh_check(&texels));
  PAGS_TRY(pags_proxy_mesh_paint(&texels, depth_views, tolerance, tasks));
  const float *color = texels.colors;
  for (int y = 0; y < side; y++)
    for (int x = 0; x < side; x++, rgb += 3) {
      const bool used = point_of(mesh, l, x, y, point);
      for (int c = 0; c < 3; c++)
        rgb[c] = used ? (uint8_t)(255 * fminf(fmaxf(color[c], 0), 1) + 0.5f) : 128;
      color += used ? 3 : 0;
    }
  return PAGS_OK;
}

static pags_result encode(int side, uint8_t *rgb, pags_texture *out) {
#ifdef PAGS_WITH_IMAGES
  pags_sink sink = {0};
  const pags_image image = {.width = side, .height = side, .channels = 3, .sample = PAGS_U8, .data = rgb};
  const pags_result result = pags_png_encode("texture", &image, &sink);
  out->png = sink.bytes;
  out->png_size = sink.size;
  return result;
#else
  (void)side, (void)rgb, (void)out;
  return pags_fail(PAGS_ERROR_UNSUPPORTED, "--texture: this build has no pictures (CMake's PAGS_IMAGE)");
#endif
}

pags_result pags_texture_bake(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                              int side, pags_tasks *tasks, pags_texture *out) {
  lattice l = {.cells = (int)fmax(ceil(sqrt((double)((mesh->triangle_count + 1) / 2))), 1)};
  l.cell = side / l.cells > LEAST_CELL ? side / l.cells : LEAST_CELL;
  const size_t pixels = (size_t)(l.cells * l.cell) * (size_t)(l.cells * l.cell);
  PAGS_AUTOFREE uint8_t *rgb = malloc(3 * pixels);
  *out = (pags_texture){.uv = malloc(6 * (size_t)mesh->triangle_count * sizeof *out->uv + 1)};
  PAGS_CHECK_MEMORY(rgb && out->uv, "a texture of %zu pixels", pixels);
  /* A corner of a triangle lies at the middle of a texel. The first triangle of a cell has its right angle at the upper
   * left, the second at the lower right. */
  for (int64_t i = 0; i < 3 * mesh->triangle_count; i++)
    for (int k = 0; k < 2; k++) {
      const int64_t triangle = i / 3, number = triangle / 2;
      const double origin = (double)((k ? number / l.cells : number % l.cells) * l.cell) + 0.5;
      const double first = i % 3 == k + 1 ? l.cell - 3 : 0;
      const double at = triangle % 2 ? origin + l.cell - 1 - first : origin + first;
      out->uv[2 * i + k] = (float)(at / (l.cells * l.cell));
    }
  PAGS_TRY(paint(mesh, &l, depth_views, tolerance, tasks, rgb));
  return encode(l.cells * l.cell, rgb, out);
}

void pags_texture_destroy(pags_texture *texture) {
  free(texture->uv);
  free(texture->png);
  *texture = (pags_texture){0};
}
