/* SPDX-License-Identifier: Apache-2.0 */
/* Base-colour textures of proxies, painted by the views that the proxies were made of. */
#ifndef PAGS_PROXY_TEXTURE_H
#define PAGS_PROXY_TEXTURE_H

#include <pags/tasks.h>

#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_texture {
  float *uv;    /* 2 for each corner of each triangle, 0..1, v downwards, as glTF has them; NULL: there is no texture */
  uint8_t *png; /* the picture as a file: 8 bits, display-referred sRGB */
  size_t png_size;
} pags_texture;

/* Bakes the colours of the views whose depth agrees to within `tolerance` metres into a texture of about `side` pixels
 * a side, more where triangles would have fewer than two pixels each. Texels that no view sees get the mean colour of
 * the others. PAGS_ERROR_UNSUPPORTED in a build without pictures. After a failure, too, the caller destroys `out`. */
pags_result pags_texture_bake(const pags_proxy_mesh *mesh, const pags_depth_views *depth_views, double tolerance,
                              int side, pags_tasks *tasks, pags_texture *out);
void pags_texture_destroy(pags_texture *texture); /* frees and zeroes */

#ifdef __cplusplus
}
#endif
#endif
