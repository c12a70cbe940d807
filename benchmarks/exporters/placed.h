/* SPDX-License-Identifier: Apache-2.0 */
/* All proxies of an exported file, placed in the world at a time, for rays and distances. */
#ifndef PAGS_BENCHMARKS_PLACED_H
#define PAGS_BENCHMARKS_PLACED_H

#include <pags/scene.h>
#include "exporters/proxy/mesh_query.h"

#include "benchmarks/exporters/glb.h"

/* Kinds of surfaces, of the street and of proxies. PAGS_KIND_GROUND is that of a proxy of the whole ground. */
typedef enum pags_kind {
  PAGS_KIND_ROAD,
  PAGS_KIND_SIDEWALK,
  PAGS_KIND_TERRAIN,
  PAGS_KIND_GROUND,
  PAGS_KIND_BUILDING,
  PAGS_KIND_TREE,
  PAGS_KIND_POLE,
  PAGS_KIND_SIGN,
  PAGS_KIND_FENCE,
  PAGS_KIND_VEHICLE,
  PAGS_KIND_PEDESTRIAN,
  PAGS_KIND_CYCLIST,
  PAGS_KIND_OTHER,
  PAGS_KIND_NONE, /* no surface */
  PAGS_KINDS
} pags_kind;
extern const char *const pags_kind_names[PAGS_KINDS];

/* A mesh node of the file. */
typedef struct pags_placed_proxy {
  const char *name; /* of the file's JSON */
  int64_t thing;    /* the topmost node with extras that it belongs to: several meshes may make up one tree */
  pags_kind kind;
  const pags_object *track; /* the moving object that it follows; NULL: it rests */
  pags_proxy_mesh mesh;     /* relative to the origin, or to the moving object's box; metres */
} pags_placed_proxy;

/* Proxies joined to one mesh; `owner` is the proxy of each triangle. */
typedef struct pags_placed_part {
  pags_proxy_mesh mesh;
  int *owner;
  pags_mesh_query *query; /* NULL: no triangles */
} pags_placed_part;

typedef struct pags_placed {
  pags_placed_proxy *list;
  int64_t count, capacity;
  double origin[3], time;         /* of the scene, metres; seconds */
  pags_placed_part still, moving; /* what rests; what moves, at `time` */
} pags_placed;

/* Reads the meshes of all nodes of the file's scene. `file` and `scene` must outlive `out`, which the caller closes
 * also after a failure. */
pags_result pags_placed_open(const pags_glb *file, const pags_scene *scene, pags_placed *out);
void pags_placed_close(pags_placed *placed);
/* Moves what moves to its place at `time` (seconds); what has no label then is absent. Must not run during queries. */
pags_result pags_placed_set_time(pags_placed *placed, double time);

/* The distance, in the world, to the first hit of a ray with a direction of unit length; infinite without a hit.
 * `proxy` receives the index of the proxy, or -1. Both functions may be called by several threads at once. */
double pags_placed_ray(const pags_placed *placed, const double origin[3], const double direction[3], int *proxy);
/* The distance from a point to the nearest proxy, metres. */
double pags_placed_distance(const pags_placed *placed, const double point[3]);

#endif
