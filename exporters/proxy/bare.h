/* SPDX-License-Identifier: Apache-2.0 */
/* Scenes that are one object or one room, which may have no metres: bare splat files, for which views are made up, and
 * objects photographed from all round. Steps fit their extent. */
#ifndef PAGS_PROXY_BARE_H
#define PAGS_PROXY_BARE_H

#include <pags/export.h>
#include <pags/tasks.h>

#include "base/memory.h"
#include "exporters/proxy/depth_view.h"
#include "exporters/proxy/mesh.h"
#include "scene/survey.h"

typedef struct pags_bare {
  pags_scene scene;         /* shares everything with the scene that was given, but for views that are made up */
  pags_scene_view *made_up; /* NULL: there are photographs */
  bool photographed;
  pags_survey survey;
  bool inside;      /* the views are from places within it, not from all round it */
  const char *note; /* static: what the proxies' notes say */
} pags_bare;

/* If the scene has no photograph that was trained on, makes views up; if it has, and they are from all round the
 * Gaussians (or options->stand says so), takes these. Else, and for drives, `out` receives NULL. Steps and ranges of
 * `options` that are 0 are set from the extent. The scene must outlive `out`. */
pags_result pags_bare_open(const pags_scene *scene, pags_proxy_options *options, pags_bare **out);
void pags_bare_close(pags_bare *bare); /* NULL is allowed */
PAGS_DEFINE_AUTO(pags_bare, pags_bare_close)

/* Sets taken[i] for the Gaussians of a room that are haze: large ones, more than 4.5 times the usual size, that aren't
 * flat. Views made up among them would see them as surfaces. PAGS_ERROR_MEMORY. */
pags_result pags_bare_mark_haze(const pags_bare *bare, const pags_gaussians *g, uint8_t *taken);

/* Makes the closed surface of something that was looked at from all round: what no view sees is solid. Parts smaller
 * than a thousandth of the largest are left out; at most options->chunk_triangles. */
pags_result pags_bare_surface(const pags_bare *bare, const pags_proxy_options *options,
                              const pags_depth_views *depth_views, pags_tasks *tasks, pags_proxy_mesh *out);

/* Replaces a surface by the level asked for: its hull, its box or its cage. `level` receives the level made and `note`
 * why it isn't the one asked for, which it is not if the surface isn't closed. */
pags_result pags_bare_level(const pags_bare *bare, const pags_proxy_options *options, pags_proxy_mesh *mesh,
                            pags_proxy_level *level, const char **note);

#endif
