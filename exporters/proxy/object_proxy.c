/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxy of an object at the level asked for: a decimated mesh (simplify.c, repair.c), a subdivided cage
 * (cage.c), a convex hull (hull.c), convex parts (convex_parts.c) or the labelled box. Also opens and closes the state
 * that all proxies share. */
#include "exporters/proxy/object_proxy.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/json.h"
#include "base/log.h"
#include "exporters/proxy/cage.h"

pags_result pags_proxy_maker_open(const pags_scene *scene, const pags_proxy_options *options, pags_tasks *tasks,
                                  pags_proxy_maker *out) {
  *out = (pags_proxy_maker){.resolved = *options, .tasks = tasks, .drawing = pags_frame_options_default()};
  PAGS_TRY(pags_bare_open(scene, &out->resolved, &out->bare));
  scene = out->scene = out->bare ? &out->bare->scene : scene;
  out->options = &out->resolved;
  if (out->bare) /* there may be no metres */
    out->drawing.near_plane = fminf(out->drawing.near_plane, 2 * (float)out->resolved.voxel);
  out->resolved.voxel = out->resolved.voxel > 0 ? out->resolved.voxel : 0.15;
  out->resolved.chunk = out->resolved.chunk > 0 ? out->resolved.chunk : 20;
  out->resolved.range = out->resolved.range > 0 ? out->resolved.range : 60;
  pags_json *json;
  double value;
  out->drawing.antialiased = scene->antialiased;
  out->drawing.extra_channels = 1;
  /* Use the low-pass filter that the scene was trained with. */
  if (scene->config && pags_json_parse_text("config", scene->config, strlen(scene->config), &json) == PAGS_OK) {
    if (pags_json_number_or(json, pags_json_root(json), "low_pass", 0.3, &value) == PAGS_OK && value >= 0)
      out->drawing.low_pass = (float)value;
    pags_json_destroy(json);
  }
  pags_result result = pags_frame_create(tasks, &out->frame);
  if (result == PAGS_OK)
    result = pags_scene_depth_draw(scene, out->frame, &out->drawing, PAGS_DEPTH_VIEW_WIDEST,
                                   !out->bare || scene->object_count > 0,
                                   &out->scene_depth); /* alone, nothing else hides it */
  if (result == PAGS_OK)
    result = pags_lidar_read(scene, 0, &out->lidar);
  if (result != PAGS_OK)
    pags_proxy_maker_close(out);
  return result;
}

void pags_proxy_maker_close(pags_proxy_maker *maker) {
  if (maker->frame)
    pags_frame_destroy(maker->frame);
  maker->frame = NULL;
  pags_scene_depth_destroy(&maker->scene_depth);
  pags_lidar_destroy(&maker->lidar);
  pags_bare_close(maker->bare);
  maker->bare = NULL;
}

static pags_result make_level(const pags_proxy_maker *w, const pags_object_shape *shape, pags_proxy_level level,
                              pags_proxy_mesh *out, pags_convex_parts *parts) {
  switch (level) {
    case PAGS_PROXY_MESH: return pags_proxy_mesh_simplify(&shape->surface, w->options->triangles, out);
    case PAGS_PROXY_CAGE:
      return pags_proxy_mesh_cage(&shape->surface, w->options->cage_level, w->options->triangles, out);
    case PAGS_PROXY_CONVEX: return pags_proxy_mesh_convex(&shape->surface, w->options->triangles, out, parts);
    default:
      return pags_proxy_mesh_hull(&shape->surface, w->options->triangles < 252 ? w->options->triangles : 252, out);
  }
}

pags_result pags_object_proxy_make(const pags_proxy_maker *maker, int64_t object, const pags_object_shape *shape,
                                   pags_proxy_level wanted, pags_proxy_mesh *out, pags_convex_parts *parts,
                                   pags_proxy_level *level, const char **note) {
  pags_proxy_mesh_topology topology;
  float color[3];
  *note = wanted == PAGS_PROXY_BOX ? NULL : shape->note;
  *level = wanted;
  parts->count = 0;
  if (wanted != PAGS_PROXY_BOX) {
    pags_result result = PAGS_ERROR_ARGUMENT;
    if (shape->surface.triangle_count)
      result = make_level(maker, shape, wanted, out, parts);
    if (result == PAGS_OK && !parts->count) /* parts touch each other, and are clean each */
      result = pags_proxy_mesh_clean(out);
    if (result == PAGS_ERROR_MEMORY || result == PAGS_CANCELLED)
      return result;
    if (result == PAGS_OK) {
      PAGS_TRY(pags_proxy_mesh_inspect(out, &topology));
      if (topology.closed)
        return PAGS_OK;
      pags_proxy_mesh_destroy(out);
      parts->count = 0;
      pags_fail(PAGS_ERROR_FORMAT, "%lld open edges, %lld crossed, volume %g", (long long)topology.open_edges,
                (long long)topology.crossed_edges, topology.volume);
    }
    if (shape->surface.triangle_count)
      pags_log_message(PAGS_LOG_INFO, "%s: %s", maker->scene->objects[object].record.id, pags_error_message());
    if (!*note || shape->surface.triangle_count)
      *note = "no closed surface could be made: the labelled box";
  }
  *level = PAGS_PROXY_BOX;

  /* The box gets the mean colour of the object's Gaussians; grey without any. */
  double sum[3] = {0};
  const pags_gaussians *g = &shape->gaussians;
  for (int c = 0; c < 3; c++) {
    for (int64_t i = 0; i < g->count; i++)
      sum[c] += 0.5 + PAGS_SH_C0 * (double)pags_plane(g, PAGS_SH + c)[i];
    color[c] = g->count ? (float)fmin(fmax(sum[c] / (double)g->count, 0), 1) : 0.5f;
  }

  return pags_proxy_mesh_box(maker->scene->objects[object].record.size, color, out);
}
