/* SPDX-License-Identifier: Apache-2.0 */
/* Gaussians as glTF with KHR_gaussian_splatting: one set of them, or one animated node for each object. */
#include "exporters/format/splat_save.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "exporters/format/bake.h"
#include "exporters/format/gltf.h"
#include "exporters/format/object_gaussians.h"
#include "maths/maths.h"
#include "scene/axes.h"

/* ---- One set of Gaussians ---- */

/* The attributes of a point primitive. */
typedef struct columns {
  float *block; /* the values of all attributes, one attribute after the other */
  pags_gltf_attribute list[24];
  char names[24][64];
  int count;
  size_t used, rows;
} columns;

static void forget_columns(columns *c) {
  free(c->block);
}

/* Adds an attribute and returns where its values go: `rows` times `components` floats. */
static float *add_column(columns *c, const char *name, int components) {
  float *values = c->block + c->used;
  snprintf(c->names[c->count], sizeof c->names[0], "%.63s", name);
  c->list[c->count] = (pags_gltf_attribute){c->names[c->count], components, values};
  c->count++;
  c->used += c->rows * (size_t)components;
  return values;
}

static pags_result add_points(pags_gltf *gltf, int node, const char *name, const pags_gaussians *g) {
  static const char extension[] =
      "{\"kernel\":\"ellipse\",\"colorSpace\":\"srgb_rec709_display\",\"projection\":\"perspective\",\"sortingMethod\":"
      "\"cameraDistance\"}";
  const size_t rows = (size_t)g->count, width = 15 + 3 * (size_t)pags_sh_coefficients(g->sh_degree);
  PAGS_AUTO(forget_columns) columns c = {.block = malloc((rows * width + 1) * sizeof *c.block), .rows = rows};
  PAGS_CHECK_MEMORY(c.block, "%lld Gaussians", (long long)g->count);

  /* COLOR_0 (constant colour in linear light, opacity) is for readers that don't know the extension and draw points. */
  float *position = add_column(&c, "POSITION", 3), *color = add_column(&c, "COLOR_0", 4),
        *rotation = add_column(&c, "KHR_gaussian_splatting:ROTATION", 4),
        *scale = add_column(&c, "KHR_gaussian_splatting:SCALE", 3),
        *opacity = add_column(&c, "KHR_gaussian_splatting:OPACITY", 1);
  for (int64_t i = 0; i < g->count; i++) {
    double q[4], length = 0;
    for (int k = 0; k < 4; k++) {
      q[k] = (double)pags_plane(g, PAGS_ROTATION + (k + 1) % 4)[i];
      length += q[k] * q[k];
    }
    for (int k = 0; k < 4; k++)
      rotation[4 * i + k] = length > 0 ? (float)(q[k] / sqrt(length)) : (float)(k == 3);
    for (int k = 0; k < 3; k++) {
      position[3 * i + k] = pags_plane(g, PAGS_MEAN + k)[i];
      scale[3 * i + k] = (float)fmin(pags_exp((double)pags_plane(g, PAGS_SCALE + k)[i]), (double)FLT_MAX);
      color[4 * i + k] = (float)pags_splat_linear(0.5 + PAGS_SH_C0 * (double)pags_plane(g, PAGS_SH + k)[i]);
    }
    opacity[i] = color[4 * i + 3] = (float)pags_splat_opacity(g, i);
  }
  for (int degree = 0, k = 0; degree <= g->sh_degree; degree++)
    for (int n = 0; n <= 2 * degree; ++n, ++k) {
      char column[64];
      snprintf(column, sizeof column, "KHR_gaussian_splatting:SH_DEGREE_%d_COEF_%d", degree, n);
      float *values = add_column(&c, column, 3);
      for (int64_t i = 0; i < g->count; i++)
        for (int channel = 0; channel < 3; channel++)
          values[3 * i + channel] = pags_plane(g, PAGS_SH + 3 * k + channel)[i];
    }
  pags_gltf_node_mesh(gltf, node,
                      pags_gltf_points(gltf, name, g->count, c.list, c.count, "KHR_gaussian_splatting", extension));
  return PAGS_OK;
}

/* What the file says of the scene besides, as extras of the asset. */
static pags_result put_asset(pags_gltf *gltf, const pags_scene *scene, float converted_from) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  pags_json_put_bool(&w, "antialiased", scene->antialiased != 0);
  pags_json_put_numbers(&w, "origin", scene->origin, 3);
  pags_json_put_string(&w, "up", pags_up_code(scene->up));
  if (converted_from > 0.0f)
    pags_json_put_number(&w, "converted_from_alpha_min", (double)converted_from);
  return pags_gltf_put_extras(gltf, -1, &w);
}

/* The rotation to glTF's Y up is the root node's, as in files of proxies, so that means, rotations and harmonics below
 * it stay in the scene's axes. */
pags_result pags_gltf_splats_save(const char *path, const pags_scene *scene, const pags_gaussians *g,
                                  float converted_from) {
  PAGS_AUTO(pags_gltf_destroy_auto) pags_gltf *gltf = NULL;
  if (!g->count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: there is no Gaussian at that time", path);
  PAGS_TRY(pags_gltf_create(&gltf));
  int root = pags_gltf_node(gltf, -1, "scene");
  pags_gltf_node_up(gltf, root, scene->up);
  PAGS_TRY(put_asset(gltf, scene, converted_from));
  PAGS_TRY(add_points(gltf, pags_gltf_node(gltf, root, "splats"), "splats", g));
  return pags_gltf_save(gltf, path);
}

/* ---- A node for each object ---- */

/* Adds the node of one object: its Gaussians in its own frame, its track as animation. `object` -1 adds the Gaussians
 * of no object as the node `background`. Adds the number of Gaussians to `count`. */
static pags_result add_owned(pags_gltf *gltf, int root, pags_composition *composition, int64_t object, double time_zero,
                             const pags_splat_options *options, int degree, int64_t *count) {
  PAGS_AUTO(pags_gaussians_destroy) pags_gaussians g = {0};
  char name[96];
  const pags_scene *scene = pags_composition_scene(composition);
  PAGS_TRY(pags_object_gaussians(composition, object, options->time, degree, &g));
  if (!g.count)
    return PAGS_OK;
  snprintf(name, sizeof name, "%.80s", object < 0 ? "background" : scene->objects[object].record.id);
  int node = pags_gltf_node(gltf, root, name);
  if (object >= 0)
    PAGS_TRY(pags_gltf_node_place(gltf, node, scene, &scene->objects[object].record, time_zero));
  *count += g.count;
  return add_points(gltf, node, name, &g);
}

pags_result pags_gltf_tracks_save(const char *path, pags_composition *composition, const pags_splat_options *options,
                                  int64_t *count) {
  const pags_scene *scene = pags_composition_scene(composition);
  PAGS_AUTO(pags_gltf_destroy_auto) pags_gltf *gltf = NULL;
  int degree;
  PAGS_TRY(pags_presence_tell(scene));
  PAGS_TRY(pags_object_gaussians_degree(composition, options->sh_degree, &degree));
  PAGS_TRY(pags_gltf_create(&gltf));
  int root = pags_gltf_node(gltf, -1, "scene");
  pags_gltf_node_up(gltf, root, scene->up);
  PAGS_TRY(put_asset(gltf, scene, 0.0f));
  *count = 0;
  for (int64_t i = -1; i < scene->object_count; i++)
    PAGS_TRY(add_owned(gltf, root, composition, i, pags_scene_time_zero(scene), options, degree, count));
  if (!*count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: there is no Gaussian", path);
  return pags_gltf_save(gltf, path);
}
