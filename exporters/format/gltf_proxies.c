/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_proxies: writes the proxy meshes of all labelled objects, of the ground and of the rest of the
 * background into one glTF file, with tracks as animation, each proxy's measured error in `extras`, and, as asked,
 * levels of detail, collision shapes and cameras. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/export.h>

#include "base/log.h"
#include "exporters/format/gltf.h"
#include "exporters/format/object_gaussians.h"
#include "exporters/proxy/background.h"
#include "exporters/proxy/object_proxy.h"
#include "exporters/proxy/proxy_error.h"
#include "scene/axes.h"
#include "scene/object.h"
#include "scene/scene_json.h"

enum { NAME_SIZE = PAGS_OBJECT_NAME, MOST_GROUPS = 256 };

static const double slab = 0.5; /* thickness of the ground among collision shapes, metres */

/* A node that gathers the proxies of one class. */
typedef struct group {
  char name[NAME_SIZE];
  int parent, node;
} group;

typedef struct exporter {
  const pags_scene *scene; /* those of `maker` */
  const pags_proxy_options *options;
  pags_proxy_maker maker;
  pags_built_object *objects; /* of the scene */
  pags_background chunks;
  pags_proxy_facts *chunk_facts; /* of each of its chunks */
  pags_texture *chunk_textures;
  pags_atlas atlas; /* of all textures */
  pags_gltf *gltf;
  pags_proxy_report *report;
  int root, critical, background; /* indices of nodes; -1: not added yet */
  int materials[2][2]; /* indices of materials: of objects and of the background (double-sided, since it may be open);
                          with colours at vertices and with the atlas */
  group groups[MOST_GROUPS];
  int group_count;
  double time_zero;        /* the scene's time, in seconds, that is 0 in the file */
  pags_json_writer shapes; /* the JSON of KHR_implicit_shapes */
  int shape_count;
  pags_progress_fn *progress;
  void *user;
} exporter;

static void forget_exporter(exporter *e) {
  pags_objects_destroy(e->objects, e->objects ? e->scene->object_count : 0);
  for (int64_t i = 0; e->chunk_textures && i < e->chunks.chunk_count; i++)
    pags_texture_destroy(&e->chunk_textures[i]);
  free(e->chunk_textures);
  pags_atlas_destroy(&e->atlas);
  free(e->chunk_facts);
  pags_background_destroy(&e->chunks);
  pags_gltf_destroy(e->gltf);
  pags_proxy_maker_close(&e->maker);
  pags_json_writer_destroy(&e->shapes);
}

static int tell_objects(void *user, double fraction, const char *what) {
  const exporter *e = user;
  return !e->progress || e->progress(e->user, e->options->background ? 0.5 * fraction : fraction, what);
}

static int tell_background(void *user, double fraction, const char *what) {
  const exporter *e = user;
  return !e->progress || e->progress(e->user, e->scene->object_count ? 0.5 + 0.5 * fraction : fraction, what);
}

/* ---- Names, groups and extras ---- */

/* The index of the node that gathers a class, below the node `critical` or `background`; adds both when they are
 * first asked for. */
static int class_node(exporter *e, bool critical, const char *class_name) {
  int *half = critical ? &e->critical : &e->background;
  char name[NAME_SIZE];
  pags_class_plain_name(class_name, name);
  if (*half < 0)
    *half = pags_gltf_node(e->gltf, e->root, critical ? "critical" : "background");

  /* Look for the class among the groups, else add a node. Beyond MOST_GROUPS classes a node isn't remembered, and a
   * class may get several. */
  for (int i = 0; i < e->group_count; i++)
    if (e->groups[i].parent == *half && !strcmp(e->groups[i].name, name))
      return e->groups[i].node;
  group added = {.parent = *half, .node = pags_gltf_node(e->gltf, *half, name)};
  memcpy(added.name, name, sizeof name);
  if (e->group_count < MOST_GROUPS)
    e->groups[e->group_count++] = added;
  return added.node;
}

static pags_result put_extras(exporter *e, int node, const pags_proxy_facts *facts, const pags_object *record) {
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  pags_proxy_facts_put(&w, facts);
  if (record) {
    pags_json_put_string(&w, "track", record->id);
    pags_json_put_string(&w, "category", pags_category_name(record->category));
    pags_json_put_numbers(&w, "size", record->size, 3);
    pags_json_put_number(&w, "time_begin", record->keyframes[0].time - e->time_zero);
    pags_json_put_number(&w, "time_end", record->keyframes[record->keyframe_count - 1].time - e->time_zero);
  }
  return pags_gltf_put_extras(e->gltf, node, &w);
}

/* ---- Objects ---- */

/* Adds a mesh, with the material of its kind, which is added with the first. */
static int add_mesh(exporter *e, const char *name, const pags_proxy_mesh *mesh, const pags_texture *texture,
                    const pags_proxy_facts *facts) {
  int *material = &e->materials[facts->object < 0][texture && texture->uv];
  if (*material < 0)
    *material = pags_gltf_material(e->gltf, facts->object < 0 ? "sheet" : "proxy", facts->object < 0,
                                   texture && texture->uv ? &e->atlas : NULL);
  return pags_gltf_mesh(e->gltf, name, mesh, texture, *material,
                        (e->options->collision            ? PAGS_GLTF_BARE
                         : facts->level < PAGS_PROXY_HULL ? PAGS_GLTF_NORMALS
                                                          : 0) |
                            (facts->closed ? PAGS_GLTF_MANIFOLD : 0));
}

static pags_result report_level(exporter *e, int64_t object, pags_built_level *built, const char *name) {
  built->facts.name = name;
  built->facts.class_name = e->scene->objects[object].record.class_name;
  return pags_proxy_report_add(e->report, &built->facts);
}

/* Adds the mesh of one level of one object to the file and its facts to the report; `mesh` receives the mesh's
 * index. */
static pags_result add_level(exporter *e, int64_t object, pags_built_level *built, const char *name, int *mesh) {
  const bool plain = e->options->naming == PAGS_NAMING_UNREAL; /* UCX_NAME_00 collides for the mesh NAME */
  char mesh_name[NAME_SIZE];
  snprintf(mesh_name, NAME_SIZE, "%.80s%s%s", name, plain ? "" : "_",
           plain ? "" : pags_proxy_level_name(built->facts.level));
  *mesh = add_mesh(e, mesh_name, &built->mesh, &built->texture, &built->facts);
  return report_level(e, object, built, name);
}

/* Makes a node a kinematic rigid body, which follows its track and which no force moves, or a collider of `mesh` (-1:
 * none), or both. The collider of a box is an implicit shape. */
static void put_physics(exporter *e, int node, bool body, const pags_proxy_facts *facts, const pags_object *record,
                        int mesh) {
  char collider[128] = "", text[192];
  if (!e->options->physics)
    return;
  if (mesh >= 0 && facts->level == PAGS_PROXY_BOX) {
    pags_json_begin_object(&e->shapes, NULL);
    pags_json_put_string(&e->shapes, "type", "box");
    pags_json_begin_object(&e->shapes, "box");
    pags_json_put_numbers(&e->shapes, "size", record->size, 3);
    pags_json_end_object(&e->shapes);
    pags_json_end_object(&e->shapes);
    snprintf(collider, sizeof collider, "\"collider\":{\"geometry\":{\"shape\":%d}}", e->shape_count++);
  } else if (mesh >= 0) {
    snprintf(collider, sizeof collider, "\"collider\":{\"geometry\":{\"mesh\":%d,\"convexHull\":%s}}", mesh,
             facts->level >= PAGS_PROXY_HULL ? "true" : "false");
  }
  snprintf(text, sizeof text, "{%s%s%s}", body ? "\"motion\":{\"isKinematic\":true}" : "", body && *collider ? "," : "",
           collider);
  pags_gltf_extension(e->gltf, node, "KHR_physics_rigid_bodies", text);
}

/* Adds a mesh that collides as a child of a node, named so that the importer of the program that options->naming names
 * makes a collision shape of it. `record` is NULL for the background. */
static pags_result add_shape(exporter *e, const pags_proxy_mesh *mesh, int number, const pags_proxy_facts *facts,
                             const pags_object *record, const char *name, int node) {
  const pags_proxy_naming naming = e->options->naming;
  char child_name[NAME_SIZE];
  if (naming == PAGS_NAMING_UNREAL)
    snprintf(child_name, NAME_SIZE, "%s_%.70s_%02d", facts->level == PAGS_PROXY_BOX ? "UBX" : "UCX", name,
             number % 100);
  else
    snprintf(child_name, NAME_SIZE, "%.70s_part%02d%s", name, number % 100,
             naming == PAGS_NAMING_GODOT ? "-convcolonly" : "");
  const int added = add_mesh(e, child_name, mesh, NULL, facts), child = pags_gltf_node(e->gltf, node, child_name);
  pags_gltf_node_mesh(e->gltf, child, added);
  put_physics(e, child, false, facts, record, added);
  return put_extras(e, child, facts, record);
}

/* Adds what an object collides with, one shape for each convex part. */
static pags_result add_shapes(exporter *e, int64_t object, pags_built_level *built, const char *name, int node) {
  const pags_object *record = &e->scene->objects[object].record;
  PAGS_TRY(report_level(e, object, built, name));
  put_physics(e, node, true, &built->facts, record, -1);
  for (int i = 0; i == 0 || i < built->parts.count; i++) {
    PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh part = {0};
    if (built->parts.count)
      PAGS_TRY(pags_convex_part(&built->mesh, &built->parts, i, &part));
    PAGS_TRY(add_shape(e, built->parts.count ? &part : &built->mesh, i, &built->facts, record, name, node));
  }
  return PAGS_OK;
}

/* Adds the levels coarser than the finest as nodes outside of the scene, and lists them in the extension MSFT_lod of
 * `node`, which holds the finest level. */
static pags_result add_coarser(exporter *e, int64_t object, pags_built_object *built, const char *name, int node) {
  char ids[96] = "", child_name[NAME_SIZE];
  int used = 0;
  for (int level = 1; level < built->level_count; level++) {
    int mesh;
    PAGS_TRY(add_level(e, object, &built->levels[level], name, &mesh));
    snprintf(child_name, NAME_SIZE, "%.80s_lod%d", name, level);
    int child = pags_gltf_node(e->gltf, -2, child_name);
    pags_gltf_node_mesh(e->gltf, child, mesh);
    PAGS_TRY(put_extras(e, child, &built->levels[level].facts, &e->scene->objects[object].record));
    used += snprintf(ids + used, sizeof ids - (size_t)used, "%s%d", used ? "," : "{\"ids\":[", child);
  }
  snprintf(ids + used, sizeof ids - (size_t)used, "]}");
  pags_gltf_extension(e->gltf, node, "MSFT_lod", ids);
  /* A level is replaced by the next coarser one when it covers less than this fraction of the screen; 0: never. */
  pags_gltf_extras(e->gltf, node, "{\"MSFT_screencoverage\":[0.2,0.05,0.02,0]}");
  return PAGS_OK;
}

static pags_result add_object(exporter *e, int64_t object, pags_built_object *built) {
  const pags_proxy_options *options = e->options;
  const pags_scene_object *o = &e->scene->objects[object];
  const bool convex = options->collision && options->naming == PAGS_NAMING_GODOT && options->level >= PAGS_PROXY_HULL;
  const bool apart =
      built->level_count == 1 && (built->levels[0].parts.count > 0 || convex); /* there are parts alone */
  char name[NAME_SIZE], child_name[NAME_SIZE];
  int mesh = -1;
  pags_object_plain_name(o->record.class_name, object, name);
  int node = pags_gltf_node(e->gltf, class_node(e, o->critical, o->record.class_name), name), holder = node;
  PAGS_TRY(pags_gltf_node_place(e->gltf, node, e->scene, &o->record, e->time_zero));
  if (!apart)
    PAGS_TRY(add_level(e, object, &built->levels[0], name, &mesh));
  if (apart || (built->level_count == 2 && !options->lod))
    PAGS_TRY(add_shapes(e, object, &built->levels[built->level_count - 1], name, node));
  else
    put_physics(e, node, true, &built->levels[0].facts, &o->record, mesh);
  PAGS_TRY(put_extras(e, node, &built->levels[0].facts, &o->record));

  /* Levels of detail, and what Godot is to make a collision shape of, are nodes below the one that moves. */
  const bool shape = options->naming == PAGS_NAMING_GODOT && built->level_count == 1 && !apart;
  if (options->lod || shape) {
    snprintf(child_name, NAME_SIZE, "%.80s%s", name,
             options->lod         ? "_lod0"
             : options->collision ? "_mesh-colonly"
                                  : "_mesh-col");
    holder = pags_gltf_node(e->gltf, node, child_name);
  }
  if (!apart)
    pags_gltf_node_mesh(e->gltf, holder, mesh);
  if (options->lod)
    PAGS_TRY(add_coarser(e, object, built, name, holder));
  if (options->visibility)
    pags_gltf_extension(e->gltf, node, "KHR_node_visibility", "{\"visible\":false}");
  return PAGS_OK;
}

/* ---- The background ---- */

/* Makes slabs of the ground's pieces, and empties the chunks that are open, since a body's inside is unknown there. */
static pags_result make_solid(pags_background *b) {
  int64_t left_out = 0, triangles = 0;
  for (int64_t i = 0; i < b->chunk_count; i++) {
    pags_chunk *chunk = &b->chunks[i];
    pags_proxy_mesh_topology topology;
    if (!strncmp(chunk->class_name, "ground", 6))
      PAGS_TRY(pags_proxy_mesh_thicken(&chunk->mesh, slab));
    PAGS_TRY(pags_proxy_mesh_inspect(&chunk->mesh, &topology));
    if (topology.closed)
      continue;
    left_out++;
    triangles += chunk->mesh.triangle_count;
    chunk->mesh.triangle_count = 0;
  }
  if (left_out)
    pags_log_message(PAGS_LOG_WARNING,
                     "collision shapes: %lld open surfaces of the background with %lld triangles are left out",
                     (long long)left_out, (long long)triangles);
  return PAGS_OK;
}

/* Whether a chunk collides by convex parts, and not itself: if the file has such parts, trees, poles and the like, for
 * Unreal also blocks. Godot's surfaces need not be convex, if they don't move. */
static bool has_shapes(const exporter *e, const pags_chunk *chunk) {
  const pags_proxy_naming naming = e->options->naming;
  return naming != PAGS_NAMING_PLAIN && e->options->level >= PAGS_PROXY_HULL &&
         (chunk->solid || (naming == PAGS_NAMING_UNREAL && chunk->unseen_depth > 0));
}

/* Adds what a chunk collides with. */
static pags_result add_chunk_shapes(exporter *e, const pags_proxy_mesh *mesh, const pags_proxy_facts *facts,
                                    const char *name, int node) {
  pags_proxy_mesh *parts;
  int64_t count;
  pags_proxy_facts own = *facts;
  own.level = PAGS_PROXY_CONVEX;
  pags_result result = pags_convex_meshes_make(mesh, &parts, &count);
  for (int64_t i = 0; i < count; i++) {
    own.vertices = parts[i].vertex_count;
    own.triangles = parts[i].triangle_count;
    if (result == PAGS_OK)
      result = add_shape(e, &parts[i], (int)i, &own, NULL, name, node);
    pags_proxy_mesh_destroy(&parts[i]);
  }
  free(parts);
  return result;
}

static pags_result add_chunk(exporter *e, int64_t index) {
  const pags_proxy_options *options = e->options;
  const pags_background *b = &e->chunks;
  const pags_chunk *chunk = &b->chunks[index];
  pags_proxy_facts *facts = &e->chunk_facts[index];
  const bool ground = !strcmp(chunk->class_name, "ground"), shapes = has_shapes(e, chunk);
  char name[NAME_SIZE] = "ground", node_name[NAME_SIZE];
  pags_proxy_mesh_topology topology;
  if (!ground)
    snprintf(name, NAME_SIZE, "%s_%03d", chunk->class_name, chunk->number);
  PAGS_TRY(pags_proxy_mesh_inspect(&chunk->mesh, &topology));
  facts->name = name;
  facts->class_name = chunk->class_name;
  facts->closed = (e->maker.bare || chunk->solid || chunk->unseen_depth > 0) && topology.closed;
  facts->volume = facts->closed ? topology.volume : 0;
  facts->note = chunk->note ? chunk->note : e->maker.bare ? e->maker.bare->note : NULL;
  facts->level = chunk->level;
  facts->object = -1;
  if (options->collision) { /* nothing that is open is left */
    facts->closed = true;
    facts->volume = topology.volume;
  }
  facts->gaussians = b->gaussians;
  facts->s_sem = b->s_sem;
  facts->vertices = chunk->mesh.vertex_count;
  facts->triangles = chunk->mesh.triangle_count;
  facts->observed = chunk->unseen_depth > 0 ? chunk->observed : pags_proxy_mesh_observed(&chunk->mesh);
  facts->unseen_depth = chunk->unseen_depth;
  if (e->background < 0)
    e->background = pags_gltf_node(e->gltf, e->root, "background");
  int parent = ground ? e->background : class_node(e, false, chunk->class_name);
  snprintf(node_name, NAME_SIZE, "%.80s%s", name,
           options->naming != PAGS_NAMING_GODOT || shapes ? ""
           : options->collision                           ? "-colonly"
                                                          : "-col");
  int node = pags_gltf_node(e->gltf, parent, node_name);
  if (!shapes || !options->collision)
    pags_gltf_node_mesh(e->gltf, node, add_mesh(e, name, &chunk->mesh, &e->chunk_textures[index], facts));
  if (shapes)
    PAGS_TRY(add_chunk_shapes(e, &chunk->mesh, facts, name, node));
  if (options->visibility)
    pags_gltf_extension(e->gltf, node, "KHR_node_visibility", "{\"visible\":false}");
  PAGS_TRY(put_extras(e, node, facts, NULL));
  return pags_proxy_report_add(e->report, facts);
}

/* Writes the surfaces of the ground as one mesh. */
static pags_result save_ground(const pags_background *b, const char *path) {
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh ground = {0};
  for (int64_t i = 0; i < b->chunk_count; i++)
    if (!strncmp(b->chunks[i].class_name, "ground", 6))
      PAGS_TRY(pags_proxy_mesh_append(&b->chunks[i].mesh, &ground));
  if (!ground.triangle_count)
    return pags_fail(PAGS_ERROR_ARGUMENT, "%s: the scene has no ground; it needs photographs and z as up axis", path);
  return pags_mesh_ply_save(path, &ground);
}

/* Makes the background's chunks and their textures. Their errors are measured together, joined into one mesh, against
 * the depth views of the background. */
static pags_result make_background(exporter *e) {
  const pags_proxy_options *options = e->options;
  pags_background *b = &e->chunks;
  PAGS_AUTO(pags_proxy_mesh_destroy) pags_proxy_mesh all = {0};
  int64_t triangles = 0;
  PAGS_TRY(pags_background_make(&e->maker, tell_background, e, b));
  if (options->ground_file)
    PAGS_TRY(save_ground(b, options->ground_file));
  for (int64_t i = 0; i < b->chunk_count; i++)
    triangles += b->chunks[i].mesh.triangle_count;
  e->chunk_facts = calloc((size_t)b->chunk_count + 1, sizeof *e->chunk_facts);
  e->chunk_textures = calloc((size_t)b->chunk_count + 1, sizeof *e->chunk_textures);
  PAGS_CHECK_MEMORY(e->chunk_facts && e->chunk_textures, "%lld chunks", (long long)b->chunk_count);
  PAGS_AUTOFREE int32_t *group_of = malloc(((size_t)triangles + 1) * sizeof *group_of);
  PAGS_CHECK_MEMORY(group_of, "%lld triangles", (long long)triangles);
  for (int64_t i = 0; i < b->chunk_count; i++) {
    const int64_t begin = all.triangle_count;
    PAGS_TRY(pags_proxy_mesh_append(&b->chunks[i].mesh, &all));
    for (int64_t t = begin; t < all.triangle_count; t++)
      group_of[t] = (int32_t)i;
  }
  PAGS_TRY(pags_proxy_tell(tell_background, e, 0.96, "background: errors"));
  PAGS_TRY(pags_proxies_compare(&all, group_of, b->chunk_count, &b->depth_views, options->range, e->maker.tasks,
                                e->chunk_facts));
  if (options->collision)
    PAGS_TRY(make_solid(b));
  if (options->texture)
    PAGS_TRY(pags_proxy_tell(tell_background, e, 0.97, "background: texture"));
  for (int64_t i = 0; i < b->chunk_count; i++)
    if (options->texture && b->chunks[i].level < PAGS_PROXY_HULL)
      PAGS_TRY(pags_texture_bake(&b->chunks[i].mesh, &b->depth_views, 3 * options->voxel,
                                 pags_texture_limit(options->texture), e->maker.tasks, &e->chunk_textures[i]));
  pags_depth_views_destroy(&b->depth_views);
  return PAGS_OK;
}

/* ---- The export ---- */

/* Packs the textures of all objects and chunks. */
static pags_result make_atlas(exporter *e) {
  const int64_t most = e->scene->object_count * PAGS_PROXY_LEVELS + e->chunks.chunk_count;
  PAGS_AUTOFREE pags_texture **textures = malloc(((size_t)most + 1) * sizeof *textures);
  PAGS_AUTOFREE int64_t *triangles = malloc(((size_t)most + 1) * sizeof *triangles);
  int64_t count = 0;
  PAGS_CHECK_MEMORY(textures && triangles, "%lld textures", (long long)most);
  for (int64_t i = 0; e->objects && i < e->scene->object_count; i++)
    for (int level = 0; level < e->objects[i].level_count; level++) {
      triangles[count] = e->objects[i].levels[level].mesh.triangle_count;
      textures[count++] = &e->objects[i].levels[level].texture;
    }
  for (int64_t i = 0; i < e->chunks.chunk_count; i++) {
    triangles[count] = e->chunks.chunks[i].mesh.triangle_count;
    textures[count++] = &e->chunk_textures[i];
  }
  return pags_atlas_make(textures, triangles, count, e->options->texture, &e->atlas);
}

static pags_result put_asset(const exporter *e) {
  const pags_scene *scene = e->scene;
  PAGS_AUTO(pags_json_writer_destroy) pags_json_writer w = {0};
  pags_json_begin_object(&w, NULL);
  pags_json_put_string(&w, "units", "metres");
  pags_json_put_string(&w, "frame",
                       "below the node 'scene' positions are in the axes of the recording, relative to origin");
  pags_json_put_numbers(&w, "origin", scene->origin, 3);
  pags_json_put_string(&w, "up", pags_up_code(scene->up));
  pags_json_put_number(&w, "time_zero", e->time_zero);
  if (scene->fps > 0)
    pags_json_put_number(&w, "fps", scene->fps);
  pags_place_to_json(&w, &scene->place);
  return pags_gltf_put_extras(e->gltf, -1, &w);
}

static pags_result fill(exporter *e) {
  const pags_scene *scene = e->scene;
  e->time_zero = pags_scene_time_zero(scene);
  e->root = pags_gltf_node(e->gltf, -1, "scene");
  pags_gltf_node_up(e->gltf, e->root, scene->up);
  if (scene->object_count)
    PAGS_TRY(pags_proxy_tell(tell_objects, e, 0, "objects"));
  if (scene->object_count)
    PAGS_TRY(pags_objects_make(&e->maker, true, tell_objects, e, &e->objects));
  if (e->options->background)
    PAGS_TRY(make_background(e));
  PAGS_TRY(pags_proxy_tell(e->progress, e->user, 0.99, "writing"));
  PAGS_TRY(make_atlas(e));
  for (int64_t i = 0; i < scene->object_count; i++)
    if (e->objects[i].level_count)
      PAGS_TRY(add_object(e, i, &e->objects[i]));
  for (int64_t i = 0; i < e->chunks.chunk_count; i++)
    if (e->chunks.chunks[i].mesh.triangle_count)
      PAGS_TRY(add_chunk(e, i));
  PAGS_TRY(pags_presence_tell(scene));
  if (e->options->cameras && e->maker.bare && !e->maker.bare->photographed)
    pags_log_message(PAGS_LOG_WARNING, "there are no photographs, so no cameras are written");
  else if (e->options->cameras)
    PAGS_TRY(pags_gltf_add_views(e->gltf, e->root, scene, e->time_zero));
  PAGS_TRY(put_asset(e));

  /* Close the list of implicit shapes; the extension is written if any box used one. */
  pags_json_end_array(&e->shapes);
  pags_json_end_object(&e->shapes);
  PAGS_TRY(pags_json_writer_finish(&e->shapes));
  if (e->shape_count)
    pags_gltf_extension(e->gltf, -1, "KHR_implicit_shapes", e->shapes.data);
  return PAGS_OK;
}

static pags_result export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                  pags_tasks *tasks, pags_progress_fn *progress, void *user,
                                  pags_proxy_report *report) {
  PAGS_AUTO(forget_exporter)
  exporter e = {.report = report,
                .critical = -1,
                .background = -1,
                .materials = {{-1, -1}, {-1, -1}},
                .progress = progress,
                .user = user};
  pags_json_begin_object(&e.shapes, NULL);
  pags_json_begin_array(&e.shapes, "shapes");
  PAGS_TRY(pags_proxy_maker_open(scene, options, tasks, &e.maker));
  e.scene = e.maker.scene;
  e.options = e.maker.options;
  PAGS_TRY(pags_gltf_create(&e.gltf));
  PAGS_TRY(fill(&e));
  if (!report->count)
    pags_log_message(PAGS_LOG_WARNING, "%s: no proxy: %s", path,
                     !pags_scene_gaussian_count(scene) ? "the scene has no Gaussians"
                     : !options->background            ? "no object was chosen, and the background neither"
                                                       : "nothing is opaque enough for a surface");
  PAGS_TRY(pags_proxy_tell(progress, user, 1, "writing"));
  return pags_gltf_save(e.gltf, path);
}

pags_result pags_export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                pags_tasks *tasks, pags_progress_fn *progress, void *user, pags_proxy_report *report) {
  pags_proxy_report own = {0};
  const pags_result result = export_proxies(scene, path, options, tasks, progress, user, &own);
  if (!report || result != PAGS_OK)
    pags_proxy_report_destroy(&own); /* zeroes it */
  if (report)
    *report = own;
  return result;
}
