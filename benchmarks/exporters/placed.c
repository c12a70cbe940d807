/* SPDX-License-Identifier: Apache-2.0 */
/* The proxies of an exported file in the world: nodes are read with their poses and classes, and joined into one mesh
 * of what rests and one of what moves, each with its bounding volumes. */
#include "benchmarks/exporters/placed.h"

#include <math.h>
#include <string.h>

#include "base/vec3.h"

enum { DEEPEST = 32 }; /* levels of nodes */

const char *const pags_kind_names[PAGS_KINDS] = {"road",       "sidewalk", "terrain", "ground", "building",
                                                 "tree",       "pole",     "sign",    "fence",  "vehicle",
                                                 "pedestrian", "cyclist",  "other",   "none"};

/* ---- Reading nodes ---- */

/* What a node passes on to its children. */
typedef struct heritage {
  double pose[12]; /* from the node to the scene relative to its origin, or to the moving object's box */
  const char *class_name;
  const pags_object *object;
  int64_t thing;
} heritage;

/* The kind of a class, or of a name that begins with one. */
static pags_kind kind_of(const char *name) {
  static const struct {
    const char *begin;
    pags_kind kind;
  } kinds[] = {{"ground_road", PAGS_KIND_ROAD},
               {"ground_sidewalk", PAGS_KIND_SIDEWALK},
               {"ground_pavement", PAGS_KIND_SIDEWALK},
               {"ground_", PAGS_KIND_TERRAIN},
               {"ground", PAGS_KIND_GROUND},
               {"road", PAGS_KIND_ROAD},
               {"sidewalk", PAGS_KIND_SIDEWALK},
               {"pavement", PAGS_KIND_SIDEWALK},
               {"terrain", PAGS_KIND_TERRAIN},
               {"verge", PAGS_KIND_TERRAIN},
               {"building", PAGS_KIND_BUILDING},
               {"wall", PAGS_KIND_BUILDING},
               {"vegetation", PAGS_KIND_TREE},
               {"tree", PAGS_KIND_TREE},
               {"bush", PAGS_KIND_TREE},
               {"pole", PAGS_KIND_POLE},
               {"lamp", PAGS_KIND_POLE},
               {"sign", PAGS_KIND_SIGN},
               {"fence", PAGS_KIND_FENCE}};
  for (size_t i = 0; name && i < sizeof kinds / sizeof kinds[0]; i++)
    if (!strncmp(name, kinds[i].begin, strlen(kinds[i].begin)))
      return kinds[i].kind;
  return PAGS_KIND_OTHER;
}

static pags_kind kind_of_node(const heritage *own, const char *name) {
  static const pags_kind of_category[] = {PAGS_KIND_OTHER, PAGS_KIND_VEHICLE, PAGS_KIND_PEDESTRIAN, PAGS_KIND_CYCLIST};
  if (own->object)
    return of_category[own->object->category];
  const pags_kind kind = kind_of(own->class_name ? own->class_name : name);
  return kind == PAGS_KIND_GROUND ? kind_of(name) : kind; /* one class, a node for each kind of ground */
}

static pags_result add_mesh(pags_placed *placed, const pags_glb *file, const pags_json_value *node,
                            const heritage *own) {
  PAGS_CHECK_MEMORY(pags_grow(&placed->list, placed->count + 1, &placed->capacity, sizeof *placed->list), "a proxy");
  pags_placed_proxy *proxy = &placed->list[placed->count++];
  const char *name = pags_glb_text(node, "name");
  *proxy = (pags_placed_proxy){.name = name ? name : "",
                               .thing = own->thing,
                               .kind = kind_of_node(own, name),
                               .track = own->object && own->object->moving ? own->object : NULL};
  PAGS_TRY(pags_glb_mesh(file, pags_glb_integer(node, "mesh", -1), &proxy->mesh));
  for (int64_t i = 0; i < proxy->mesh.vertex_count; i++) {
    double p[3], q[3];
    pags_proxy_mesh_point(&proxy->mesh, i, p);
    pags_rigid_point(own->pose, p, q);
    pags_narrow3(q, proxy->mesh.positions + 3 * i);
  }
  return PAGS_OK;
}

/* Adds the meshes of a node and of those below it. A moving object's pose is that of its track. */
static pags_result add_node(pags_placed *placed, const pags_glb *file, const pags_scene *scene, int64_t index,
                            heritage own, int depth) {
  static const double identity[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
  const pags_json_value *node = pags_glb_element(file, "nodes", index), *extras = pags_glb_member(node, "extras");
  const char *track = pags_glb_text(extras, "track"), *class_name = pags_glb_text(extras, "class");
  const pags_scene_object *object = track ? pags_scene_find_object(scene, track) : NULL;
  if (!node || depth > DEEPEST)
    return pags_fail(PAGS_ERROR_FORMAT, "node %lld is missing or nested too deeply", (long long)index);
  if (depth > 0) { /* that of the root turns to Y up */
    double pose[12];
    pags_glb_pose(node, pose);
    pags_rigid_multiply(own.pose, pose, own.pose);
  }
  if (object && &object->record != own.object) {
    own.object = &object->record;
    if (own.object->moving)
      memcpy(own.pose, identity, sizeof own.pose);
  }
  own.class_name = class_name ? class_name : own.class_name;
  if (own.thing < 0 && class_name)
    own.thing = index;
  if (pags_glb_member(node, "mesh"))
    PAGS_TRY(add_mesh(placed, file, node, &own));
  const pags_json_value *children = pags_glb_member(node, "children");
  for (const pags_json_value *child = children ? children->first : NULL; child; child = child->next)
    PAGS_TRY(add_node(placed, file, scene, (int64_t)child->number, own, depth + 1));
  return PAGS_OK;
}

/* ---- Joining ---- */

static void close_part(pags_placed_part *part) {
  pags_mesh_query_destroy(part->query);
  pags_proxy_mesh_destroy(&part->mesh);
  free(part->owner);
  *part = (pags_placed_part){0};
}

/* Joins the proxies that rest, or those that move, where they are at `time`. */
static pags_result join(const pags_placed *placed, bool moving, double time, pags_placed_part *out) {
  int64_t capacity = 0;
  close_part(out);
  for (int64_t i = 0; i < placed->count; i++) {
    const pags_placed_proxy *proxy = &placed->list[i];
    const int64_t vertex = out->mesh.vertex_count, triangle = out->mesh.triangle_count;
    double pose[12] = {0}, p[3], q[3];
    if (moving != (proxy->track != NULL) || (moving && !pags_object_pose(proxy->track, time, pose)))
      continue;
    PAGS_TRY(pags_proxy_mesh_append(&proxy->mesh, &out->mesh));
    pags_pose_subtract(pose, placed->origin);
    for (int64_t v = vertex; moving && v < out->mesh.vertex_count; v++) {
      pags_proxy_mesh_point(&out->mesh, v, p);
      pags_rigid_point(pose, p, q);
      pags_narrow3(q, out->mesh.positions + 3 * v);
    }
    PAGS_CHECK_MEMORY(pags_grow(&out->owner, out->mesh.triangle_count, &capacity, sizeof *out->owner), "triangles");
    for (int64_t t = triangle; t < out->mesh.triangle_count; t++)
      out->owner[t] = (int)i;
  }
  return out->mesh.triangle_count ? pags_mesh_query_of_mesh(&out->mesh, &out->query) : PAGS_OK;
}

pags_result pags_placed_open(const pags_glb *file, const pags_scene *scene, pags_placed *out) {
  *out = (pags_placed){.time = (double)NAN};
  const heritage root = {.pose = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}, .thing = -1};
  pags_copy3(scene->origin, out->origin);
  const pags_json_value *roots =
      pags_glb_member(pags_glb_element(file, "scenes", pags_glb_integer(file->root, "scene", 0)), "nodes");
  for (const pags_json_value *node = roots ? roots->first : NULL; node; node = node->next)
    PAGS_TRY(add_node(out, file, scene, (int64_t)node->number, root, 0));
  return join(out, false, 0, &out->still);
}

void pags_placed_close(pags_placed *placed) {
  for (int64_t i = 0; i < placed->count; i++)
    pags_proxy_mesh_destroy(&placed->list[i].mesh);
  free(placed->list);
  close_part(&placed->still);
  close_part(&placed->moving);
  *placed = (pags_placed){0};
}

pags_result pags_placed_set_time(pags_placed *placed, double time) {
  if (time == placed->time)
    return PAGS_OK;
  placed->time = time;
  return join(placed, true, time, &placed->moving);
}

/* ---- Queries ---- */

double pags_placed_ray(const pags_placed *placed, const double origin[3], const double direction[3], int *proxy) {
  const pags_placed_part *const parts[2] = {&placed->still, &placed->moving};
  double nearest = HUGE_VAL, from[3];
  *proxy = -1;
  pags_subtract3(origin, placed->origin, from);
  for (int i = 0; i < 2; i++) {
    uint32_t triangle;
    const double t = parts[i]->query ? pags_mesh_query_ray(parts[i]->query, from, direction, &triangle) : -1;
    if (t < 0 || t >= nearest)
      continue;
    nearest = t;
    *proxy = parts[i]->owner[triangle];
  }
  return nearest;
}

double pags_placed_distance(const pags_placed *placed, const double point[3]) {
  const pags_mesh_query *const queries[2] = {placed->still.query, placed->moving.query};
  double at[3], nearest = HUGE_VAL;
  pags_subtract3(point, placed->origin, at);
  for (int i = 0; i < 2; i++)
    nearest = queries[i] ? fmin(nearest, pags_mesh_query_distance(queries[i], at, NULL)) : nearest;
  return nearest;
}
