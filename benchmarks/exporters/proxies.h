/* SPDX-License-Identifier: Apache-2.0 */
/* State and measurements of pags-bench proxies, shared by its files. */
#ifndef PAGS_BENCHMARKS_PROXIES_H
#define PAGS_BENCHMARKS_PROXIES_H

#include <pags/scene.h>
#include "exporters/proxy/proxy_error.h"
#include "synth/stage.h"
#include "synth/street.h"

#include "benchmarks/exporters/glb.h"
#include "benchmarks/exporters/placed.h"
#include "cli/common/session.h"

/* A ray that is traced through the true street and through the proxies at once. */
typedef struct pags_bench_ray {
  double origin[3], direction[3]; /* world, metres; the direction has unit length */
  int group;                      /* the measurement's own number for it */
  double time;                    /* seconds; of the street and of the proxies */
  double truth, proxy;            /* distances to the first hits, metres; infinite: nothing is hit */
  double normal[3];               /* of the true surface, towards the origin */
  pags_kind kind;                 /* of the true surface; PAGS_KIND_NONE: nothing is hit */
  int placement;                  /* of the street, that is hit; -1: none */
  int placed;                     /* index of the proxy that is hit; -1: none */
  double gap;                     /* from the true surface to the nearest proxy, metres (first_hits.c alone) */
  bool seen;                      /* a training camera saw the true surface there */
} pags_bench_ray;

typedef struct pags_bench_rays {
  pags_bench_ray *list;
  int64_t count, capacity;
} pags_bench_rays;

typedef struct pags_proxy_bench {
  pags_session session;
  pags_scene scene;
  pags_glb file;
  pags_street_options options;
  pags_street street;
  pags_stage *stage;
  double stage_time;
  pags_placed placed;
  pags_json_writer json;
  int failures;
  int pictures; /* 1: the truth is in pictures (truth/depth, truth/ids), not in the rebuilt street */
} pags_proxy_bench;

/* Moves the street's actors to their poses at `time` (seconds). */
pags_result pags_proxy_bench_time(pags_proxy_bench *self, double time);
/* Writes a distance summary as an array: mean, 95th percentile, maximum. */
void pags_proxy_bench_put(pags_json_writer *w, const char *key, const pags_proxy_distance *d);
/* Measures the proxy of a labelled object, which is the mesh of `node`; does nothing unless the object is a
 * vehicle. */
pags_result pags_proxy_bench_vehicle(pags_proxy_bench *self, const pags_json_value *node, const char *track);

/* ---- Rays (cast.c) ---- */

/* Appends a ray; `direction` may have any length. */
pags_result pags_bench_add_ray(pags_bench_rays *rays, const double origin[3], const double direction[3], int group);
void pags_bench_free_rays(pags_bench_rays *rays);
/* Traces rays first .. count - 1 at `time`. */
pags_result pags_bench_cast(pags_proxy_bench *self, double time, pags_bench_rays *rays, int64_t first);
/* Finds out which of the true surfaces that the rays hit were seen by a training camera: one within 40 m, from which
 * nothing hides the point, and which looks at it by no less than 3 degrees. */
pags_result pags_bench_see(pags_proxy_bench *self, pags_bench_rays *rays);
/* The point at a distance along a ray. */
void pags_bench_point(const pags_bench_ray *ray, double distance, double out[3]);
/* The time of the middle time step, at which measurements of the whole street are made; seconds. */
double pags_bench_middle(const pags_proxy_bench *self);
/* Adds level rays, 6 above one another, at the house fronts (group 0) and at all trees, poles, signs and bins (their
 * placement in the street is the group), each from a few metres off. */
pags_result pags_bench_aim_at_feet(const pags_proxy_bench *self, pags_bench_rays *rays);
/* A share as "97.3 %", or "-" of nothing. Returns `text`. */
const char *pags_bench_share(char text[16], int64_t part, int64_t of);

/* ---- Measurements of whole files against the rebuilt street; each prints a table and adds a member to the JSON. ----
 */

pags_result pags_bench_first_hits(pags_proxy_bench *self); /* first_hits.c */
pags_result pags_bench_feet(pags_proxy_bench *self);       /* feet.c */
pags_result pags_bench_drops(pags_proxy_bench *self);      /* drops.c */
pags_result pags_bench_parts(pags_proxy_bench *self);      /* parts.c */
pags_result pags_bench_shadows(pags_proxy_bench *self);    /* shadows.c */

#endif
