/* SPDX-License-Identifier: Apache-2.0 */
/* Base-colour textures of proxies, painted by the views that the proxies were made of: each mesh is cut into charts
 * (charts.c), these are painted (texture.c), and the charts of all meshes of a file are packed into one picture
 * (atlas.c). */
#ifndef PAGS_PROXY_TEXTURE_H
#define PAGS_PROXY_TEXTURE_H

#include <pags/tasks.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

/* A part of a surface, flat enough to be projected on a plane without overlap, and the picture of it. */
typedef struct pags_chart {
  int width, height; /* pixels */
  int64_t texel;     /* the first of its width * height texels among those of the texture */
} pags_chart;

typedef struct pags_texture {
  float *uv; /* 2 for each corner of each triangle: pixels in its chart, whose first texel has its middle at (0.5, 0.5);
                in an atlas 0..1, v downwards, as glTF has them. NULL: there is no texture */
  int32_t *chart_of; /* of each triangle */
  pags_chart *charts;
  int64_t chart_count, chart_capacity;
  uint8_t *rgb; /* 3 a texel, display-referred sRGB */
  int64_t texel_count;
} pags_texture;

void pags_texture_destroy(pags_texture *texture); /* frees and zeroes */

/* Cuts a mesh into charts of at most `most` texels together: fills all of `out` but rgb. `need` are the texels per
 * metre wanted at each triangle, above 0. `owners` receives the triangle that each texel shows, -1 for none; free() it.
 * After a failure, too, the caller destroys `out`. */
pags_result pags_charts_make(const pags_proxy_mesh *mesh, const float *need, double most, pags_texture *out,
                             int32_t **owners);

/* Makes charts with as many texels per metre as the nearest view that sees the surface has pixels there, and paints
 * them with the colours of the views whose depth agrees to within `tolerance` metres. Texels that no view sees get the
 * colours around them. At most `most` texels. After a failure, too, the caller destroys `out`. */
pags_result pags_texture_bake(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                              double most, pags_tasks *tasks, pags_texture *out);

/* The most texels of one texture in an atlas of `side` pixels a side. */
static inline double pags_texture_limit(int side) {
  return 0.8 * side * side;
}

/* The picture that all textures of a file share. */
typedef struct pags_atlas {
  int width, height;
  uint8_t *jpeg; /* the picture as a file; NULL: there is no texture */
  size_t jpeg_size;
} pags_atlas;

/* Packs the charts of all textures into a picture of at most `side` pixels a side, all with the same share of their
 * resolution where there is no room for more, and turns their `uv` into places in it; frees their texels. Around each
 * chart, its border is continued by some pixels, so that filtering doesn't show its neighbours. PAGS_ERROR_UNSUPPORTED
 * in a build without pictures. After a failure, too, the caller destroys `out`. */
pags_result pags_atlas_make(pags_texture *const *textures, const int64_t *triangles, int64_t count, int side,
                            pags_atlas *out);
void pags_atlas_destroy(pags_atlas *atlas); /* frees and zeroes */

#ifdef __cplusplus
}
#endif
#endif
