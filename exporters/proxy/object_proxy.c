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
#include "frame/owners.h"

pags_result pags_proxy_maker_open(const pags_scene *scene, const pags_proxy_options *options, pags_tasks *tasks,
                                  pags_proxy_maker *out) {
  *out = (pags_proxy_maker){.resolved = *options, .tasks = tasks, .drawing = pags_frame_options_default()};
  out->options = &out->resolved;
  PAGS_TRY(pags_bare_open(scene, &out->resolved, &out->bare));
  scene = out->scene = out->bare ? &out->bare->scene : scene;
  if (out->bare) /* there may be no metres */
    out->drawing.near_plane = fminf(out->drawing.near_plane, 2 * (float)out->resolved.voxel);
  out->resolved.voxel = out->resolved.voxel > 0 ? out->resolved.voxel : 0.15;
  out->resolved.chunk = out->resolved.chunk > 0 ? out->resolved.chunk : 20;
  out->resolved.range = out->resolved.range > 0 ? out->resolved.range : 60;
  out->drawing.antialiased = scene->antialiased;
  out->drawing.extra_channels = 1;
  /* Use the low-pass filter that the scene was trained with. */
  PAGS_AUTO(pags_json_destroy_auto) pags_json *json = NULL;
  double value;
  if (scene->config && pags_json_parse_text("config", scene->config, strlen(scene->config), &json) == PAGS_OK &&
      pags_json_number_or(json, pags_json_root(json), "low_pass", 0.3, &value) == PAGS_OK && value >= 0)
    out->drawing.low_pass = (float)value;
  PAGS_TRY(pags_frame_create(tasks, &out->frame));
  PAGS_TRY(pags_scene_depth_draw(scene, out->frame, &out->drawing, PAGS_DEPTH_VIEW_WIDEST,
                                 !out->bare || scene->object_count > 0, /* alone, nothing else hides it */
                                 &out->scene_depth));
  return pags_lidar_read(scene, false, &out->lidar);
}

void pags_proxy_maker_close(pags_proxy_maker *maker) {
  pags_frame_destroy_auto(&maker->frame);
  pags_scene_depth_destroy(&maker->scene_depth);
  pags_lidar_destroy(&maker->lidar);
  pags_bare_close(maker->bare);
}

static pags_result make_level(const pags_proxy_options *options, const pags_object_shape *shape, pags_proxy_level level,
                              pags_built_level *out) {
  switch (level) {
    case PAGS_PROXY_MESH: return pags_proxy_mesh_simplify(&shape->surface, options->triangles, &out->mesh);
    case PAGS_PROXY_CAGE:
      return pags_proxy_mesh_cage(&shape->surface, options->cage_level, options->triangles, &out->mesh);
    case PAGS_PROXY_CONVEX: return pags_proxy_mesh_convex(&shape->surface, options->triangles, &out->mesh, &out->parts);
    default:
      return pags_proxy_mesh_hull(&shape->surface, options->triangles < 252 ? options->triangles : 252, &out->mesh);
  }
}

pags_result pags_object_proxy_make(const pags_proxy_maker *maker, int64_t object, const pags_object_shape *shape,
                                   pags_built_level *out) {
  const pags_object *record = &maker->scene->objects[object].record;
  pags_proxy_facts *facts = &out->facts;
  if (facts->level != PAGS_PROXY_BOX) {
    pags_result result = PAGS_ERROR_ARGUMENT;
    facts->note = shape->note;
    if (shape->surface.triangle_count)
      result = make_level(maker->options, shape, facts->level, out);
    if (result == PAGS_OK && !out->parts.count) /* parts touch each other, and are clean each */
      result = pags_proxy_mesh_clean(&out->mesh);
    if (result == PAGS_ERROR_MEMORY || result == PAGS_CANCELLED)
      return result;
    if (result == PAGS_OK) {
      pags_proxy_mesh_topology topology;
      PAGS_TRY(pags_proxy_mesh_inspect(&out->mesh, &topology));
      if (topology.closed)
        return PAGS_OK;
      pags_fail(PAGS_ERROR_FORMAT, "%lld open edges, %lld crossed, volume %g", (long long)topology.open_edges,
                (long long)topology.crossed_edges, topology.volume);
    }
    pags_proxy_mesh_destroy(&out->mesh);
    out->parts.count = 0;
    if (shape->surface.triangle_count)
      pags_log_message(PAGS_LOG_INFO, "%s: %s", record->id, pags_error_message());
    if (!facts->note || shape->surface.triangle_count)
      facts->note = "no closed surface could be made: the labelled box";
    facts->level = PAGS_PROXY_BOX;
  }

  /* The box gets the mean colour of the object's Gaussians; grey without any. */
  const pags_gaussians *g = &shape->gaussians;
  float color[3];
  for (int c = 0; c < 3; c++) {
    double sum = 0;
    for (int64_t i = 0; i < g->count; i++)
      sum += 0.5 + PAGS_SH_C0 * (double)pags_plane(g, PAGS_SH + c)[i];
    color[c] = g->count ? (float)fmin(fmax(sum / (double)g->count, 0), 1) : 0.5f;
  }
  return pags_proxy_mesh_box(record->size, color, &out->mesh);
}
