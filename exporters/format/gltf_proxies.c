/* SPDX-License-Identifier: Apache-2.0 */
/* pags_export_proxies: writes the proxy meshes of all labelled objects, of the ground and of the rest of the
 * background into one glTF file, with tracks as animation, each proxy's measured error in `extras`, and, as asked,
 * levels of detail, collision shapes and cameras. */
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <pags/export.h>

#include "base/json.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "exporters/format/gltf.h"
#include "exporters/format/gltf_cameras.h"
#include "exporters/format/presence.h"
#include "exporters/proxy/background.h"
#include "exporters/proxy/objects.h"
#include "exporters/proxy/proxy_error.h"
#include "exporters/proxy/proxy_report.h"
#include "scene/axes.h"
#include "scene/object.h"
#include "scene/scene_json.h"

enum { NAME_SIZE = PAGS_OBJECT_NAME, MOST_GROUPS = 256 };

/* A node that gathers the proxies of one class. */
typedef struct group {
  char name[NAME_SIZE];
  int parent, node;
} group;

typedef struct exporter {
  pags_proxy_maker maker;
  pags_gltf *gltf;
  pags_proxy_report *report;
  int root, critical, background; /* indices of nodes; -1: not added yet */
  int material, sheet;            /* indices of materials: of closed meshes, of open ones (double-sided) */
  group groups[MOST_GROUPS];
  int group_count;
  double time_zero;        /* the scene's time, in seconds, that is 0 in the file */
  pags_json_writer shapes; /* the JSON of KHR_implicit_shapes */
  int shape_count;
  pags_progress_fn *progress;
  void *user;
} exporter;

static pags_result tell(const exporter *self, double fraction, const char *what) {
  if (self->progress && !self->progress(self->user, fraction, what))
    return pags_fail(PAGS_CANCELLED, "interrupted");
  return PAGS_OK;
}

/* ---- Names, groups and extras ---- */

/* The index of the node that gathers a class, below the node `critical` or `background`; adds both when they are
 * first asked for. */
static int class_node(exporter *self, int critical, const char *class_name) {
  int *half = critical ? &self->critical : &self->background;
  char name[NAME_SIZE];
  pags_class_plain_name(class_name, name);
  if (*half < 0)
    *half = pags_gltf_node(self->gltf, self->root, critical ? "critical" : "background");

  /* Look for the class among the groups, else add a node. Beyond MOST_GROUPS classes a node isn't remembered, and a
   * class may get several. */
  for (int i = 0; i < self->group_count; i++)
    if (self->groups[i].parent == (*half) && !strcmp(self->groups[i].name, name))
      return self->groups[i].node;
  int node = pags_gltf_node(self->gltf, (*half), name);
  if (self->group_count < MOST_GROUPS) {
    group *added = &self->groups[self->group_count++];
    added->parent = (*half);
    added->node = node;
    snprintf(added->name, NAME_SIZE, "%s", name);
  }
  return node;
}

static pags_result put_extras(exporter *self, int node, const pags_proxy_facts *facts, const pags_object *record) {
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_proxy_facts_put(&w, facts);
  if (record) {
    pags_json_put_string(&w, "track", record->id);
    pags_json_put_string(&w, "category", pags_category_name(record->category));
    pags_json_put_numbers(&w, "size", record->size, 3);
    pags_json_put_number(&w, "time_begin", record->keyframes[0].time - self->time_zero);
    pags_json_put_number(&w, "time_end", record->keyframes[record->keyframe_count - 1].time - self->time_zero);
  }
  pags_json_end_object(&w);
  pags_result result = pags_json_writer_finish(&w);
  if (result == PAGS_OK)
    pags_gltf_node_extras(self->gltf, node, w.data);
  pags_json_writer_destroy(&w);
  return result;
}

/* ---- Objects ---- */

/* The pose of an object at one of its labels, relative to the scene's origin. */
static void pose_at(const exporter *self, const pags_object *object, const pags_keyframe *keyframe, double out[12]) {
  if (!pags_object_pose(object, keyframe->time, out))
    memcpy(out, keyframe->world_from_object, 12 * sizeof *out);
  for (int k = 0; k < 3; k++)
    out[4 * k + 3] -= self->maker.scene->origin[k];
}

/* Gives a node the object's pose: a moving object gets the pose of its first label and its track as animation, a
 * parked one the pose of the middle one of its labels. */
static pags_result place(exporter *self, int node, const pags_object *object) {
  double first[12];
  pose_at(self, object, &object->keyframes[object->moving ? 0 : object->keyframe_count / 2], first);
  pags_gltf_node_pose(self->gltf, node, first);
  if (!object->moving || object->keyframe_count < 2)
    return PAGS_OK;
  double *times = malloc((size_t)object->keyframe_count * sizeof *times);
  double(*poses)[12] = malloc((size_t)object->keyframe_count * sizeof *poses);
  pags_result result = times && poses ? PAGS_OK : pags_out_of_memory("a track");
  for (int64_t i = 0; i < object->keyframe_count && result == PAGS_OK; i++) {
    times[i] = object->keyframes[i].time - self->time_zero;
    pose_at(self, object, &object->keyframes[i], poses[i]);
  }
  if (result == PAGS_OK)
    pags_gltf_node_track(self->gltf, node, object->keyframe_count, times, (const double(*)[12])poses);
  free(times);
  free(poses);
  return result;
}

static int add_mesh(exporter *self, const char *name, const pags_proxy_mesh *mesh, const pags_texture *texture,
                    const pags_proxy_facts *facts) {
  return pags_gltf_mesh(
      self->gltf, name, mesh, texture, texture && texture->uv ? 0 : self->material,
      (facts->level < PAGS_PROXY_HULL ? PAGS_GLTF_NORMALS : 0) | (facts->closed ? PAGS_GLTF_MANIFOLD : 0));
}

static pags_result report_level(exporter *self, int64_t object, pags_built_level *built, const char *name) {
  built->facts.name = name;
  built->facts.class_name = self->maker.scene->objects[object].record.class_name;
  return pags_proxy_report_add(self->report, &built->facts);
}

/* Adds the mesh of one level of one object to the file and its facts to the report; `mesh` receives the mesh's
 * index. */
static pags_result add_level(exporter *self, int64_t object, pags_built_level *built, const char *name, int *mesh) {
  const bool plain = self->maker.options->naming == PAGS_NAMING_UNREAL; /* UCX_NAME_00 collides for the mesh NAME */
  char mesh_name[NAME_SIZE];
  snprintf(mesh_name, NAME_SIZE, "%.80s%s%s", name, plain ? "" : "_",
           plain ? "" : pags_proxy_level_name(built->facts.level));
  *mesh = add_mesh(self, mesh_name, &built->mesh, &built->texture, &built->facts);
  return report_level(self, object, built, name);
}

/* Makes a node a kinematic rigid body, which follows its track and which no force moves, or a collider of `mesh` (-1:
 * none), or both. The collider of a box is an implicit shape. */
static void put_physics(exporter *self, int node, bool body, const pags_proxy_facts *facts, const pags_object *record,
                        int mesh) {
  char collider[128] = "", text[192];
  if (!self->maker.options->physics)
    return;
  if (mesh >= 0 && facts->level == PAGS_PROXY_BOX) {
    pags_json_begin_object(&self->shapes, NULL);
    pags_json_put_string(&self->shapes, "type", "box");
    pags_json_begin_object(&self->shapes, "box");
    pags_json_put_numbers(&self->shapes, "size", record->size, 3);
    pags_json_end_object(&self->shapes);
    pags_json_end_object(&self->shapes);
    snprintf(collider, sizeof collider, "\"collider\":{\"geometry\":{\"shape\":%d}}", self->shape_count++);
  } else if (mesh >= 0) {
    snprintf(collider, sizeof collider, "\"collider\":{\"geometry\":{\"mesh\":%d,\"convexHull\":%s}}", mesh,
             facts->level >= PAGS_PROXY_HULL ? "true" : "false");
  }
  snprintf(text, sizeof text, "{%s%s%s}", body ? "\"motion\":{\"isKinematic\":true}" : "", body && *collider ? "," : "",
           collider);
  pags_gltf_node_extension(self->gltf, node, "KHR_physics_rigid_bodies", text);
}

/* Adds what an object collides with as children of its node, one for each convex part, named so that the importer of
 * the program that options->naming names makes collision shapes of them. */
static pags_result add_shapes(exporter *self, int64_t object, pags_built_level *built, const char *name, int node) {
  const pags_proxy_naming naming = self->maker.options->naming;
  const pags_object *record = &self->maker.scene->objects[object].record;
  PAGS_TRY(report_level(self, object, built, name));
  put_physics(self, node, true, &built->facts, record, -1);
  for (int i = 0; i == 0 || i < built->parts.count; i++) {
    pags_proxy_mesh part = {0};
    char child_name[NAME_SIZE];
    if (naming == PAGS_NAMING_UNREAL)
      snprintf(child_name, NAME_SIZE, "%s_%.70s_%02d", built->facts.level == PAGS_PROXY_BOX ? "UBX" : "UCX", name,
               i % 100);
    else
      snprintf(child_name, NAME_SIZE, "%.70s_part%02d%s", name, i % 100,
               naming == PAGS_NAMING_GODOT ? "-convcolonly" : "");
    if (built->parts.count)
      PAGS_TRY(pags_convex_part(&built->mesh, &built->parts, i, &part));
    const int mesh = add_mesh(self, child_name, built->parts.count ? &part : &built->mesh, NULL, &built->facts);
    pags_proxy_mesh_destroy(&part);
    const int child = pags_gltf_node(self->gltf, node, child_name);
    pags_gltf_node_mesh(self->gltf, child, mesh);
    put_physics(self, child, false, &built->facts, record, mesh);
    PAGS_TRY(put_extras(self, child, &built->facts, record));
  }
  return PAGS_OK;
}

/* Adds the levels coarser than the finest as nodes outside of the scene, and lists them in the extension MSFT_lod of
 * `node`, which holds the finest level. */
static pags_result add_coarser(exporter *self, int64_t object, pags_built_object *built, const char *name, int node) {
  char ids[96] = "", child_name[NAME_SIZE];
  int used = 0;
  for (int level = 1; level < built->level_count; level++) {
    int mesh;
    PAGS_TRY(add_level(self, object, &built->levels[level], name, &mesh));
    snprintf(child_name, NAME_SIZE, "%.80s_lod%d", name, level);
    int child = pags_gltf_node(self->gltf, -2, child_name);
    pags_gltf_node_mesh(self->gltf, child, mesh);
    PAGS_TRY(put_extras(self, child, &built->levels[level].facts, &self->maker.scene->objects[object].record));
    used += snprintf(ids + used, sizeof ids - (size_t)used, "%s%d", used ? "," : "{\"ids\":[", child);
  }
  snprintf(ids + used, sizeof ids - (size_t)used, "]}");
  pags_gltf_node_extension(self->gltf, node, "MSFT_lod", ids);
  /* A level is replaced by the next coarser one when it covers less than this fraction of the screen; 0: never. */
  pags_gltf_node_extras(self->gltf, node, "{\"MSFT_screencoverage\":[0.2,0.05,0.02,0]}");
  return PAGS_OK;
}

static pags_result add_object(exporter *self, int64_t object, pags_built_object *built) {
  const pags_proxy_options *options = self->maker.options;
  const pags_scene_object *o = &self->maker.scene->objects[object];
  const bool apart = built->level_count == 1 && built->levels[0].parts.count > 0; /* there are parts alone */
  char name[NAME_SIZE], child_name[NAME_SIZE];
  int mesh = -1;
  pags_object_plain_name(o->record.class_name, object, name);
  int node = pags_gltf_node(self->gltf, class_node(self, o->critical, o->record.class_name), name), holder = node;
  PAGS_TRY(place(self, node, &o->record));
  if (!apart)
    PAGS_TRY(add_level(self, object, &built->levels[0], name, &mesh));
  if (apart || (built->level_count == 2 && !options->lod))
    PAGS_TRY(add_shapes(self, object, &built->levels[built->level_count - 1], name, node));
  else
    put_physics(self, node, true, &built->levels[0].facts, &o->record, mesh);
  PAGS_TRY(put_extras(self, node, &built->levels[0].facts, &o->record));

  /* Levels of detail, and what Godot is to make a collision shape of, are nodes below the one that moves. */
  const bool shape = options->naming == PAGS_NAMING_GODOT && built->level_count == 1 && !apart;
  if (options->lod || shape) {
    snprintf(child_name, NAME_SIZE, "%.80s%s", name, options->lod ? "_lod0" : "_mesh-col");
    holder = pags_gltf_node(self->gltf, node, child_name);
  }
  if (!apart)
    pags_gltf_node_mesh(self->gltf, holder, mesh);
  if (options->lod)
    PAGS_TRY(add_coarser(self, object, built, name, holder));
  if (options->visibility)
    pags_gltf_node_extension(self->gltf, node, "KHR_node_visibility", "{\"visible\":false}");
  return PAGS_OK;
}

/* ---- The asset ---- */

static pags_result put_asset(const exporter *self) {
  const pags_scene *scene = self->maker.scene;
  pags_json_writer w;
  pags_json_writer_init(&w, 0);
  pags_json_begin_object(&w, NULL);
  pags_json_put_string(&w, "units", "metres");
  pags_json_put_string(&w, "frame",
                       "below the node 'scene' positions are in the axes of the recording, relative to origin");
  pags_json_put_numbers(&w, "origin", scene->origin, 3);
  pags_json_put_string(&w, "up", pags_up_code(scene->up));
  pags_json_put_number(&w, "time_zero", self->time_zero);
  if (scene->fps > 0)
    pags_json_put_number(&w, "fps", scene->fps);
  pags_place_to_json(&w, &scene->place);
  pags_json_end_object(&w);
  pags_result result = pags_json_writer_finish(&w);
  if (result == PAGS_OK)
    pags_gltf_asset_extras(self->gltf, w.data);
  pags_json_writer_destroy(&w);
  return result;
}

static void find_time_zero(exporter *self) {
  const pags_scene *scene = self->maker.scene;
  self->time_zero = scene->time_begin;
  for (int64_t i = 0; i < scene->object_count; i++)
    self->time_zero = fmin(self->time_zero, scene->objects[i].record.keyframes[0].time);
}

static int tell_background(void *user, double fraction, const char *what) {
  const exporter *self = user;
  return tell(self, self->maker.scene->object_count ? 0.5 + 0.5 * fraction : fraction, what) == PAGS_OK;
}

/* ---- The background ---- */

/* Joins all chunks into one mesh; `group_of` (freed by the caller) receives the chunk of each triangle. */
static pags_result join_chunks(const pags_background *b, pags_proxy_mesh *all, int32_t **group_of) {
  int64_t triangles = 0;
  for (int64_t i = 0; i < b->chunk_count; i++)
    triangles += b->chunks[i].mesh.triangle_count;
  *group_of = malloc(((size_t)triangles + 1) * sizeof **group_of);
  PAGS_CHECK_MEMORY(*group_of, "%lld triangles", (long long)triangles);
  for (int64_t i = 0; i < b->chunk_count; i++) {
    const pags_proxy_mesh *s = &b->chunks[i].mesh;
    uint32_t first = (uint32_t)all->vertex_count;
    for (int64_t v = 0; v < s->vertex_count; v++)
      pags_proxy_mesh_vertex(all, s->positions + 3 * v, s->colors + 3 * v, s->observed[v]);
    for (int64_t t = 0; t < s->triangle_count; t++) {
      (*group_of)[all->triangle_count] = (int32_t)i;
      pags_proxy_mesh_triangle(all, first + s->triangles[3 * t], first + s->triangles[3 * t + 1],
                               first + s->triangles[3 * t + 2]);
    }
  }
  return pags_proxy_mesh_check(all);
}

static pags_result add_chunk(exporter *self, const pags_background *b, int64_t index, pags_proxy_facts *facts) {
  const pags_chunk *chunk = &b->chunks[index];
  char name[NAME_SIZE];
  if (!strcmp(chunk->class_name, "ground"))
    snprintf(name, NAME_SIZE, "ground");
  else
    snprintf(name, NAME_SIZE, "%s_%03d", chunk->class_name, chunk->number);
  facts->name = name;
  facts->class_name = chunk->class_name;
  pags_proxy_mesh_topology topology;
  PAGS_TRY(pags_proxy_mesh_inspect(&chunk->mesh, &topology));
  facts->closed = self->maker.bare && topology.closed;
  facts->volume = facts->closed ? topology.volume : 0;
  facts->note = chunk->note ? chunk->note : self->maker.bare ? self->maker.bare->note : NULL;
  facts->level = chunk->level;
  facts->object = -1;
  facts->gaussians = b->gaussians;
  facts->s_sem = b->s_sem;
  facts->vertices = chunk->mesh.vertex_count;
  facts->triangles = chunk->mesh.triangle_count;
  facts->observed = pags_proxy_mesh_observed(&chunk->mesh);
  if (self->background < 0)
    self->background = pags_gltf_node(self->gltf, self->root, "background");
  int parent = strcmp(chunk->class_name, "ground") ? class_node(self, 0, chunk->class_name) : self->background;
  char node_name[NAME_SIZE];
  snprintf(node_name, NAME_SIZE, "%.80s%s", name, self->maker.options->naming == PAGS_NAMING_GODOT ? "-col" : "");
  int node = pags_gltf_node(self->gltf, parent, node_name);
  pags_texture texture = {0};
  if (self->maker.options->texture && chunk->level < PAGS_PROXY_HULL)
    PAGS_TRY(pags_texture_bake(&chunk->mesh, &b->depth_views, 3 * self->maker.options->voxel,
                               self->maker.options->texture, self->maker.tasks, &texture));
  pags_gltf_node_mesh(self->gltf, node,
                      pags_gltf_mesh(self->gltf, name, &chunk->mesh, &texture, texture.uv ? 1 : self->sheet,
                                     (chunk->level < PAGS_PROXY_HULL ? PAGS_GLTF_NORMALS : 0) |
                                         (facts->closed ? PAGS_GLTF_MANIFOLD : 0)));
  pags_texture_destroy(&texture);
  if (self->maker.options->visibility)
    pags_gltf_node_extension(self->gltf, node, "KHR_node_visibility", "{\"visible\":false}");
  PAGS_TRY(put_extras(self, node, facts, NULL));
  return pags_proxy_report_add(self->report, facts);
}

/* Measures the error of all chunks, against the depth views of the background, into facts[chunk]. */
static pags_result measure_chunks(exporter *self, const pags_background *b, pags_proxy_facts *facts) {
  pags_proxy_mesh all = {0};
  int32_t *group_of = NULL;
  pags_result result = join_chunks(b, &all, &group_of);
  if (result == PAGS_OK)
    result = pags_proxies_compare(&all, group_of, b->chunk_count, &b->depth_views, self->maker.options->range,
                                  self->maker.tasks, facts);
  free(group_of);
  pags_proxy_mesh_destroy(&all);
  return result;
}

static int tell_objects(void *user, double fraction, const char *what) {
  const exporter *self = user;
  return tell(self, self->maker.options->background ? 0.5 * fraction : fraction, what) == PAGS_OK;
}

/* ---- The export ---- */

static pags_result add_objects(exporter *self) {
  const pags_scene *scene = self->maker.scene;
  pags_built_object *built;
  PAGS_TRY(pags_objects_make(&self->maker, 1, tell_objects, self, &built));
  pags_result result = PAGS_OK;
  for (int64_t i = 0; i < scene->object_count && result == PAGS_OK; i++)
    if (built[i].level_count)
      result = add_object(self, i, &built[i]);
  pags_objects_destroy(built, scene->object_count);
  return result;
}

static pags_result fill(exporter *self) {
  const pags_scene *scene = self->maker.scene;
  find_time_zero(self);
  self->root = pags_gltf_node(self->gltf, -1, "scene");
  pags_gltf_node_up(self->gltf, self->root, scene->up);
  if (scene->object_count)
    self->material = pags_gltf_material(self->gltf, "proxy", 0);
  if (scene->object_count)
    PAGS_TRY(add_objects(self));
  if (self->maker.options->background) {
    /* The background's chunks are added after their errors have been measured together. */
    pags_background b;
    PAGS_TRY(pags_background_make(&self->maker, tell_background, self, &b));
    pags_proxy_facts *facts = calloc((size_t)b.chunk_count + 1, sizeof *facts);
    pags_result result = facts ? PAGS_OK : pags_out_of_memory("%lld chunks", (long long)b.chunk_count);
    if (b.chunk_count) /* open meshes: readers that cull back faces would show nothing from behind */
      self->sheet = pags_gltf_material(self->gltf, "sheet", 1);
    if (result == PAGS_OK)
      result = measure_chunks(self, &b, facts);
    for (int64_t i = 0; i < b.chunk_count && result == PAGS_OK; i++)
      result = add_chunk(self, &b, i, &facts[i]);
    free(facts);
    pags_background_destroy(&b);
    PAGS_TRY(result);
  }
  PAGS_TRY(pags_presence_tell(scene));
  if (self->maker.options->cameras && self->maker.bare)
    pags_log_message(PAGS_LOG_WARNING, "there are no photographs, so no cameras are written");
  else if (self->maker.options->cameras)
    PAGS_TRY(pags_gltf_add_views(self->gltf, self->root, scene, self->time_zero));
  PAGS_TRY(put_asset(self));

  /* Close the list of implicit shapes; the extension is written if any box used one. */
  pags_json_end_array(&self->shapes);
  pags_json_end_object(&self->shapes);
  PAGS_TRY(pags_json_writer_finish(&self->shapes));
  if (self->shape_count)
    pags_gltf_extension(self->gltf, "KHR_implicit_shapes", self->shapes.data);
  return PAGS_OK;
}

pags_result pags_export_proxies(const pags_scene *scene, const char *path, const pags_proxy_options *options,
                                pags_tasks *tasks, pags_progress_fn *progress, void *user, pags_proxy_report *report) {
  pags_proxy_report own = {0};
  exporter self = {
      .report = report ? report : &own, .critical = -1, .background = -1, .progress = progress, .user = user};
  *self.report = own;
  pags_json_writer_init(&self.shapes, 0);
  pags_json_begin_object(&self.shapes, NULL);
  pags_json_begin_array(&self.shapes, "shapes");
  pags_result result = pags_proxy_maker_open(scene, options, tasks, &self.maker);
  if (result == PAGS_OK)
    result = pags_gltf_create(&self.gltf);
  if (result == PAGS_OK)
    result = fill(&self);
  if (result == PAGS_OK && !self.report->count)
    pags_log_message(PAGS_LOG_WARNING, "%s: no proxy: %s", path,
                     !pags_scene_gaussian_count(scene) ? "the scene has no Gaussians"
                     : !options->background            ? "no object was chosen, and the background neither"
                                                       : "nothing is opaque enough for a surface");
  if (result == PAGS_OK)
    result = tell(&self, 1, "writing");
  if (result == PAGS_OK)
    result = pags_gltf_save(self.gltf, path);
  pags_gltf_destroy(self.gltf);
  pags_proxy_maker_close(&self.maker);
  pags_json_writer_destroy(&self.shapes);
  if (!report || result != PAGS_OK)
    pags_proxy_report_destroy(self.report);
  return result;
}
