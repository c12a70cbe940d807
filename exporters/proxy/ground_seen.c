/* SPDX-License-Identifier: Apache-2.0 */
/* Continues the ground as far as cameras see it. At flat angles neither pixels nor LiDAR rings tell its height, but the
 * semantic pictures tell that it is there: a cell at the height of the nearest ground is wanted if more of the views
 * that look at it show ground than show something else. */
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "exporters/proxy/background.h"
#include "exporters/proxy/columns.h"
#include "exporters/proxy/ground.h"

enum { STRIDE = 2 }; /* cells of a square, in x and y, that are decided together */

/* Distance of a view up to which it counts, metres. A depth may be off by the height of a pixel, which grows as the
 * square of the distance: metres and share. Nearer surfaces hide the place; the label also holds where the depth is not
 * known, or too large, as few Gaussians make it there. */
static const double farthest = 45, vague = 0.3, vaguer = 0.15;

/* Whether views show ground at a point. */
static bool shows_ground(const pags_depth_views *views, const double p[3]) {
  int ground = 0, others = 0, x, y;
  double z;
  for (int64_t v = 0; v < views->count; v++) {
    const pags_depth_view *view = &views->list[v];
    if (!view->labels || !pags_depth_view_project(view, p, &x, &y, &z) || z > farthest)
      continue;
    const int64_t pixel = (int64_t)y * view->camera.width + x;
    const uint8_t label = view->labels[pixel];
    const double depth = fabs((double)view->depth[pixel]);
    if (depth > 0 && depth < z - vague - vaguer * z)
      continue;
    const uint8_t class = pags_class_of_label(label);
    if (class == PAGS_CHUNK_ROAD || class == PAGS_CHUNK_SIDEWALK || label == PAGS_LABEL_TERRAIN)
      ground++;
    else if (class < PAGS_CHUNK_SURFACE) /* sky, people and vehicles tell nothing of the ground */
      others++;
  }
  return ground > others;
}

pags_result pags_ground_see(const pags_depth_views *depth_views, int64_t *queue, pags_ground *g) {
  const size_t cells = (size_t)((int64_t)g->nx * g->ny);
  PAGS_AUTOFREE float *nearest = malloc(cells * sizeof *nearest);
  PAGS_CHECK_MEMORY(nearest, "the ground's %zu cells", cells);
  pags_ground_spread(g, nearest, queue);
  for (int64_t y = 0; y + STRIDE <= g->ny; y += STRIDE)
    for (int64_t x = 0; x + STRIDE <= g->nx; x += STRIDE) {
      const int64_t first = y * g->nx + x;
      const double p[3] = {g->x0 + ((double)x + 0.5 * (STRIDE - 1)) * g->step,
                           g->y0 + ((double)y + 0.5 * (STRIDE - 1)) * g->step, (double)nearest[first]};
      bool all = true;
      for (int k = 0; k < STRIDE * STRIDE; k++)
        all = all && g->known[first + k / STRIDE * g->nx + k % STRIDE];
      if (all || !shows_ground(depth_views, p))
        continue;
      for (int k = 0; k < STRIDE * STRIDE; k++) {
        uint8_t *known = &g->known[first + k / STRIDE * g->nx + k % STRIDE];
        *known = *known ? *known : PAGS_GROUND_WANTED;
      }
    }
  return PAGS_OK;
}
