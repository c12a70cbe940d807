/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxies of everything that is not a labelled object: the ground, and the rest in chunks: blocks, or the
 * surface by tile and class. */
#ifndef PAGS_PROXY_BACKGROUND_H
#define PAGS_PROXY_BACKGROUND_H

#include "exporters/proxy/columns.h"
#include "exporters/proxy/object_proxy.h"

typedef struct pags_chunk {
  const char *class_name; /* static: "ground", "road", "building", ... */
  int number;             /* running number in its class, from 0 */
  pags_proxy_mesh mesh;   /* relative to the scene's origin */
  pags_proxy_level level; /* the level that represents a background without photographs */
  const char *note;       /* static, or NULL */
  double unseen_depth;    /* of a block: how far it reaches behind the surface that was seen, metres; else 0 */
  double observed;        /* of a block: the share of its surface that was seen */
  bool solid;             /* it consists of closed parts, and isn't decimated or cropped */
} pags_chunk;

typedef struct pags_background {
  pags_depth_views depth_views; /* in the scene's frame */
  int64_t gaussians;            /* number of the background's Gaussians */
  double s_sem;                 /* their mean semantic priority; NaN if unknown */
  int64_t chunk_count, chunk_capacity;
  pags_chunk *chunks;   /* the ground first, if there is one */
  pags_cloud cloud;     /* of LiDAR, above the ground; unless chunks are surfaces */
  pags_columns columns; /* of the cloud */
  bool labelled;        /* classes are from the data set's semantic pictures, not guessed from shape and colour */
} pags_background;

/* Makes the ground and the chunks. `tell` is called with fractions 0..1. After a failure, too, the caller destroys
 * `out`. */
pags_result pags_background_make(const pags_proxy_maker *w, pags_progress_fn *tell, void *user, pags_background *out);
void pags_background_destroy(pags_background *background);

/* ---- The list of chunks (chunks.c) ---- */

/* Appends a chunk, which takes over the mesh unless it fails. */
pags_result pags_background_add(pags_background *background, const char *class_name, pags_proxy_mesh *mesh);
/* The same for a chunk of closed parts that stays as it is. */
pags_result pags_background_add_solid(pags_background *background, const char *class_name, pags_proxy_mesh *mesh);

/* Leaves out the triangles whose middle is outside of the options' box or ball. */
pags_result pags_proxy_mesh_crop(const pags_proxy_options *options, pags_proxy_mesh *mesh);

/* Decimates all chunks but the ground to options->chunk_triangles together, blocks only if they alone are more; crops
 * and cleans them; leaves out the empty ones. */
pags_result pags_background_finish(const pags_proxy_maker *maker, pags_background *background);

/* ---- What is made, but for blocks (blocks.h) ---- */

enum {
  PAGS_POLE_TRIANGLES = 60, /* most of a pole, a sign, a lamp or a fence */
  PAGS_CROWN_HULLS = 6      /* most of a tree's crown */
};

/* Adds a mesh for each connected surface of road, pavement or verge as chunks "ground_road", "ground_pavement" and
 * "ground_verge" (ground_parts.c), at most options->ground_triangles triangles together. `b` must be labelled. */
pags_result pags_ground_parts_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground);

/* Adds each tree of the fused surface of vegetation as a chunk "tree", a trunk and at most PAGS_CROWN_HULLS convex
 * hulls, each closed, and each bush as a chunk "bush" of hulls (trees.c). */
pags_result pags_trees_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                            pags_proxy_mesh *joined);

/* Adds each of the background's columns that is a pole as a chunk "pole", "sign" (it has a plate) or "lamp" (it has an
 * arm), and the fences (poles.c). `joined`: the fused surface of poles, where arms are looked for that LiDAR missed. */
pags_result pags_poles_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground,
                            pags_proxy_mesh *joined);
/* Adds what the semantic pictures show as fences as chunks "fence" (fences.c). */
pags_result pags_fences_make(const pags_proxy_maker *w, pags_background *b, const pags_ground *ground);

/* ---- Classes of the surface: by the data set's semantic pictures, else by shape and colour (classes.c) ---- */

/* BUILDING: walls and fences, too. SURFACE: all of a scene without photographs. */
enum {
  PAGS_CHUNK_ROAD,
  PAGS_CHUNK_SIDEWALK,
  PAGS_CHUNK_BUILDING,
  PAGS_CHUNK_VEGETATION,
  PAGS_CHUNK_POLE,
  PAGS_CHUNK_OTHER,
  PAGS_CHUNK_SURFACE,
  PAGS_CHUNK_CLASSES
};
extern const char *const pags_class_names[PAGS_CHUNK_CLASSES]; /* "road", "sidewalk", "building", ... */

/* The class of one of Cityscapes' train ids; none of them for sky, people and vehicles. */
uint8_t pags_class_of_label(uint8_t label);

/* Loads the data set's semantic picture of a view, if there is one, at the depth view's size. */
void pags_classes_load(const pags_proxy_maker *maker, const pags_scene_view *view, pags_depth_view *depth_view);

/* Finds the class of each vertex: of the pictures with `labelled`, else guessed. */
pags_result pags_classes_find(const pags_proxy_maker *maker, const pags_depth_views *depth_views, bool labelled,
                              const pags_proxy_mesh *mesh, uint8_t *class_of);

#endif
