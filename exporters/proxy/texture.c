/* SPDX-License-Identifier: Apache-2.0 */
/* Paints the charts of a mesh. Where no view sees a texel, the picture is halved until all texels have a colour, and
 * the halves fill the gaps (push-pull: Gortler et al., The Lumigraph, 1996). */
#include "exporters/proxy/texture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "exporters/proxy/tsdf.h"

static const double least_need = 0.25; /* of the mean, for surface that is hardly seen or not at all */

void pags_texture_destroy(pags_texture *texture) {
  free(texture->uv);
  free(texture->chart_of);
  free(texture->charts);
  free(texture->rgb);
  *texture = (pags_texture){0};
}

/* Finds the texels per metre wanted at each triangle: the most pixels per metre with which a view sees one of its
 * corners or its middle. */
static pags_result find_need(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                             pags_tasks *tasks, float *need) {
  static const float none[3] = {0};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh points = {0};
  PAGS_AUTOFREE float *density = malloc((4 * (size_t)mesh->triangle_count + 1) * sizeof *density);
  PAGS_CHECK_MEMORY(density, "a texture of %lld triangles", (long long)mesh->triangle_count);
  for (int64_t t = 0; t < mesh->triangle_count; t++) {
    double middle[3];
    float narrow[3];
    pags_proxy_mesh_middle(mesh, t, middle);
    pags_narrow3(middle, narrow);
    pags_proxy_mesh_vertex(&points, narrow, none, 1);
    for (int k = 0; k < 3; k++)
      pags_proxy_mesh_vertex(&points, mesh->positions + 3 * mesh->triangles[3 * t + k], none, 1);
  }
  PAGS_TRY(pags_proxy_mesh_check(&points));
  PAGS_TRY(pags_proxy_mesh_paint_seen(&points, depth_views, tolerance, density, tasks));
  double sum = 0, weight = 0;
  for (int64_t t = 0; t < mesh->triangle_count; t++) {
    double n[3];
    pags_proxy_mesh_cross(mesh, t, n);
    need[t] = fmaxf(fmaxf(density[4 * t], density[4 * t + 1]), fmaxf(density[4 * t + 2], density[4 * t + 3]));
    sum += need[t] > 0 ? pags_length3(n) * (double)need[t] : 0;
    weight += need[t] > 0 ? pags_length3(n) : 0;
  }
  for (int64_t t = 0; t < mesh->triangle_count; t++)
    need[t] = fmaxf(need[t], (float)(sum > 0 ? least_need * sum / weight : 1));
  return PAGS_OK;
}

/* The point of the mesh that the middle of a texel of a chart shows. */
static void point_of(const pags_proxy_mesh *mesh, const pags_texture *texture, int64_t triangle, int x, int y,
                     float out[3]) {
  const float *t = texture->uv + 6 * triangle;
  const double ax = (double)(t[2] - t[0]), ay = (double)(t[3] - t[1]), bx = (double)(t[4] - t[0]),
               by = (double)(t[5] - t[1]), px = x + 0.5 - (double)t[0], py = y + 0.5 - (double)t[1],
               whole = ax * by - ay * bx; /* not 0: the triangle covers the texel */
  const double b = (px * by - py * bx) / whole, c = (ax * py - ay * px) / whole;
  double p[3][3];
  pags_proxy_mesh_corners(mesh, triangle, p);
  for (int k = 0; k < 3; k++)
    out[k] = (float)((1 - b - c) * p[0][k] + b * p[1][k] + c * p[2][k]);
}

/* The colour of a picture around a point in its pixels, linear between the middles of texels. */
static void between(const float *texels, int width, int height, float u, float v, float out[3]) {
  u = fminf(fmaxf(u - 0.5f, 0), (float)(width - 1));
  v = fminf(fmaxf(v - 0.5f, 0), (float)(height - 1));
  const int x = (int)u, y = (int)v, right = x + 1 < width, down = y + 1 < height ? width : 0;
  const float *at = texels + 4 * ((int64_t)y * width + x), a = u - (float)x, b = v - (float)y;
  for (int c = 0; c < 3; c++)
    out[c] = (1 - b) * ((1 - a) * at[c] + a * at[4 * right + c]) +
             b * ((1 - a) * at[4 * down + c] + a * at[4 * (down + right) + c]);
}

/* Fills a picture of 4 numbers a texel, the share of it that has a colour and before it that colour times the share.
 * The missing share of a texel comes from the picture of half the size, and from `mean` if no texel has a colour. False
 * if out of memory. */
static bool fill(float *texels, int width, int height, const float mean[3]) {
  const int half_width = (width + 1) / 2, half_height = (height + 1) / 2;
  int64_t gaps = 0;
  for (int64_t i = 0; i < (int64_t)width * height; i++)
    gaps += texels[4 * i + 3] < 1;
  if (!gaps)
    return true;
  if (width * height == 1) {
    for (int c = 0; c < 3; c++)
      texels[c] = texels[3] > 0 ? texels[c] / texels[3] : mean[c];
    return true;
  }
  PAGS_AUTOFREE float *half = calloc((size_t)half_width * (size_t)half_height, 4 * sizeof *half);
  if (!half)
    return false;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      const int parts = (x == width - 1 && width % 2 ? 1 : 2) * (y == height - 1 && height % 2 ? 1 : 2);
      for (int c = 0; c < 4; c++)
        half[4 * ((int64_t)(y / 2) * half_width + x / 2) + c] +=
            texels[4 * ((int64_t)y * width + x) + c] / (float)parts;
    }
  if (!fill(half, half_width, half_height, mean))
    return false;
  for (int y = 0; y < height; y++)
    for (int x = 0; x < width; x++) {
      float *to = texels + 4 * ((int64_t)y * width + x), around[3];
      between(half, half_width, half_height, 0.5f * (float)x + 0.25f, 0.5f * (float)y + 0.25f, around);
      for (int c = 0; c < 3; c++)
        to[c] += (1 - to[3]) * around[c];
    }
  return true;
}

static pags_result paint(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                         const int32_t *owners, pags_tasks *tasks, pags_texture *out) {
  static const float none[3] = {0};
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh points = {0};
  PAGS_AUTOFREE float *texels = calloc((size_t)out->texel_count + 1, 4 * sizeof *texels);
  out->rgb = malloc(3 * (size_t)out->texel_count + 1);
  PAGS_CHECK_MEMORY(texels && out->rgb, "a texture of %lld texels", (long long)out->texel_count);
  for (const pags_chart *chart = out->charts; chart < out->charts + out->chart_count; chart++)
    for (int i = 0; i < chart->width * chart->height; i++) {
      const int32_t owner = owners[chart->texel + i];
      float point[3];
      if (owner < 0)
        continue;
      point_of(mesh, out, owner, i % chart->width, i / chart->width, point);
      pags_proxy_mesh_vertex(&points, point, none, 1);
    }
  PAGS_TRY(pags_proxy_mesh_check(&points));
  PAGS_TRY(pags_proxy_mesh_paint_seen(&points, depth_views, tolerance, NULL, tasks));
  double sum[3] = {0}, seen = 0;
  const float *color = points.colors;
  for (int64_t i = 0; i < out->texel_count; i++) {
    if (owners[i] < 0)
      continue;
    if (color[0] >= 0) {
      memcpy(texels + 4 * i, (const float[4]){color[0], color[1], color[2], 1}, 4 * sizeof *texels);
      for (int c = 0; c < 3; c++)
        sum[c] += (double)color[c];
      seen++;
    }
    color += 3;
  }
  float mean[3];
  for (int c = 0; c < 3; c++)
    mean[c] = seen > 0 ? (float)(sum[c] / seen) : 0.5f;
  for (const pags_chart *chart = out->charts; chart < out->charts + out->chart_count; chart++)
    PAGS_CHECK_MEMORY(fill(texels + 4 * chart->texel, chart->width, chart->height, mean), "a chart of %dx%d texels",
                      chart->width, chart->height);
  for (int64_t i = 0; i < 3 * out->texel_count; i++)
    out->rgb[i] = (uint8_t)(255 * fminf(texels[i / 3 * 4 + i % 3], 1) + 0.5f);
  return PAGS_OK;
}

pags_result pags_texture_bake(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                              double most, pags_tasks *tasks, pags_texture *out) {
  PAGS_AUTOFREE float *need = malloc(((size_t)mesh->triangle_count + 1) * sizeof *need);
  PAGS_AUTOFREE int32_t *owners = NULL;
  PAGS_CHECK_MEMORY(need, "a texture of %lld triangles", (long long)mesh->triangle_count);
  PAGS_TRY(find_need(mesh, depth_views, tolerance, tasks, need));
  PAGS_TRY(pags_charts_make(mesh, need, most, out, &owners));
  return paint(mesh, depth_views, tolerance, owners, tasks, out);
}
