/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the proxy of one labelled object in the object's frame: first the surface fused from its depth views
 * (object_surface.c), then of that surface the level asked for (object_proxy.c). Several objects in parallel:
 * objects.c. */
#ifndef PAGS_PROXY_OBJECT_PROXY_H
#define PAGS_PROXY_OBJECT_PROXY_H

#include <pags/export.h>

#include "exporters/proxy/bare.h"
#include "exporters/proxy/convex_parts.h"
#include "exporters/proxy/lidar.h"
#include "exporters/proxy/scene_depth.h"
#include "exporters/proxy/shape_prior.h"
#include "exporters/proxy/texture.h"

enum { PAGS_LEAST_GAUSSIANS = 16 }; /* an object of fewer Gaussians is not drawn, so no surface is fused of it */

/* The pose of an object at one of its labels, relative to the scene's origin. That of a parked object is the pose at
 * its middle one, keyframe_count / 2. */
void pags_object_label_pose(const pags_scene *scene, const pags_object *object, int64_t label, double out[12]);

/* Copies the Gaussians with taken[i] equal to `wanted`. PAGS_ERROR_MEMORY. */
pags_result pags_gaussians_select(const pags_gaussians *from, const uint8_t *taken, bool wanted, pags_gaussians *out);

/* The state that all objects of an export and the background share. */
typedef struct pags_proxy_maker {
  const pags_scene *scene;
  const pags_proxy_options *options;
  pags_proxy_options resolved; /* what `options` points to: steps that were 0 are set */
  pags_bare *bare;             /* NULL: there are photographs */
  pags_tasks *tasks;
  pags_frame *frame;
  pags_frame_options drawing;     /* options of drawing with the frame, as the scene was trained; origin zero */
  pags_scene_depth scene_depth;   /* depth of the whole scene in each training view, for occlusion */
  pags_lidar lidar;               /* LiDAR points of the training sweeps; empty if there is no LiDAR */
  const pags_shape_prior *priors; /* shapes of well-seen vehicles, to complete what no camera saw of others */
  int64_t prior_count;
} pags_proxy_maker;

/* `out` must not be moved until it is closed, also after a failure; copies of it are good for as long. */
pags_result pags_proxy_maker_open(const pags_scene *scene, const pags_proxy_options *options, pags_tasks *tasks,
                                  pags_proxy_maker *out);
void pags_proxy_maker_close(pags_proxy_maker *maker);

/* An object's Gaussians, the depth views of them from its training cameras, and the surface fused from these. */
typedef struct pags_object_shape {
  pags_gaussians gaussians;     /* in the object's frame if it has a model of its own, else in the scene's frame */
  double s_sem;                 /* mean semantic priority of the Gaussians; NaN if unknown */
  pags_depth_views depth_views; /* in the object's frame */
  int64_t surface_pixels;       /* number of pixels of all depth views that have a depth */
  pags_proxy_mesh surface;      /* closed, at full resolution; empty if too little was seen */
  double voxel;                 /* step of the TSDF, metres */
  const char *note; /* static: why the object was seen too little, and what replaces its surface; NULL: seen enough */
} pags_object_shape;

typedef struct pags_built_level {
  pags_proxy_mesh mesh; /* in the object's frame */
  pags_convex_parts parts;
  pags_texture texture;   /* with options->texture, of meshes and cages */
  pags_proxy_facts facts; /* name and class are not set */
} pags_built_level;

/* Draws the object's depth views, fuses them and makes the closed surface. `shape->surface` stays empty if too little
 * was seen; that is no error. After a failure, too, the caller destroys the shape. */
pags_result pags_object_shape_make(const pags_proxy_maker *maker, int64_t object, pags_object_shape *shape);
/* Makes the shape prior of one vehicle of its own depth views alone. `out->distance` stays NULL if too little was
 * seen. */
pags_result pags_object_prior_make(const pags_proxy_maker *maker, int64_t object, pags_shape_prior *out);
/* The number of pixels that the object's box covers in all training views, as they would be drawn. */
double pags_object_pixels(const pags_proxy_maker *maker, int64_t object);
/* Sets taken[i] to 1 for each Gaussian i of the background model that belongs to this parked object. */
void pags_object_mark(const pags_proxy_maker *maker, int64_t object, uint8_t *taken);
void pags_object_shape_destroy(pags_object_shape *shape);

/* Makes the proxy of the level facts.level of `out`: its mesh and, for PAGS_PROXY_CONVEX, its parts. If that can't be
 * made, it makes the labelled box, changes the level, and facts.note (static) says why. */
pags_result pags_object_proxy_make(const pags_proxy_maker *maker, int64_t object, const pags_object_shape *shape,
                                   pags_built_level *out);

/* ---- All objects (objects.c) ---- */

typedef struct pags_built_object {
  int level_count; /* levels made: 0 if the object is not chosen, else 1; with options->lod mesh to box, finest first;
                      with the names of a program the mesh and what it collides with, unless that is the mesh */
  pags_built_level levels[PAGS_PROXY_LEVELS];
} pags_built_object;

/* Makes an array with an entry for each of the scene's objects. With `measure`, facts have the measured distances and
 * the silhouettes' overlap. The results are the same for any number of threads. `tell` (may be NULL) is called with
 * fractions 0..1, by the calling thread only. After a failure, too, the caller destroys them. */
pags_result pags_objects_make(const pags_proxy_maker *maker, bool measure, pags_progress_fn *tell, void *user,
                              pags_built_object **out);
void pags_objects_destroy(pags_built_object *objects, int64_t count); /* NULL is allowed */

#endif
