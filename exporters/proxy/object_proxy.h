/* SPDX-License-Identifier: Apache-2.0 */
/* The proxy of one labelled object, in its own frame. */
#ifndef PAGS_PROXY_OBJECT_PROXY_H
#define PAGS_PROXY_OBJECT_PROXY_H

#include <pags/export.h>

#include "exporters/proxy/lidar.h"
#include "exporters/proxy/scene_depth.h"
#include "exporters/proxy/shape_prior.h"

#ifdef __cplusplus
extern "C" {
#endif

enum { PAGS_LEAST_GAUSSIANS = 16 }; /* of an object: of fewer no surface is made */

/* What all objects of an export share. */
typedef struct pags_proxy_maker {
  const pags_scene *scene;
  const pags_proxy_options *options;
  pags_tasks *tasks;
  pags_frame *frame;
  pags_frame_options drawing;     /* of the frame, origin zero */
  pags_scene_depth scene_depth;   /* what hides what */
  pags_lidar lidar;               /* what it measured, where there is one */
  const pags_shape_prior *priors; /* of vehicles that are well seen, for what no camera sees of others */
  int64_t prior_count;
} pags_proxy_maker;

pags_result pags_proxy_maker_open(const pags_scene *scene, const pags_proxy_options *options, pags_tasks *tasks,
                                  pags_proxy_maker *out);
void pags_proxy_maker_close(pags_proxy_maker *maker);

/* An object's Gaussians, how its training cameras see them, and the surface fused from that. */
typedef struct pags_object_shape {
  pags_gaussians gaussians;     /* relative to `world_from_model`'s frame: the object's or the scene's */
  double s_sem;                 /* mean; NaN */
  pags_depth_views depth_views; /* in the object's frame */
  int64_t surface_pixels;       /* of all depth views that have a depth within the box */
  pags_proxy_mesh surface;      /* closed, at full resolution; empty where too little is seen */
  double voxel;
  const char *note; /* static: what was too little to see, and what stands for it; NULL: enough */
} pags_object_shape;

/* `shape->surface` stays empty when there is not enough to make one of; that is no error. */
pags_result pags_object_shape_make(const pags_proxy_maker *maker, int64_t object, pags_object_shape *shape);
/* A rough form of it alone. Its distance stays NULL when nothing is seen. */
pags_result pags_object_prior_make(const pags_proxy_maker *maker, int64_t object, pags_shape_prior *out);
/* How much of the training views it may fill. */
double pags_object_pixels(const pags_proxy_maker *maker, int64_t object);
/* Sets `taken` (one byte a Gaussian of the background) where it is this parked object's. */
void pags_object_mark(const pags_proxy_maker *maker, int64_t object, uint8_t *taken);
void pags_object_shape_destroy(pags_object_shape *shape);

/* The level asked for; where it can't be, the box, `note` (static) saying why. `level` receives what was made. */
pags_result pags_object_proxy_make(const pags_proxy_maker *maker, int64_t object, const pags_object_shape *shape,
                                   pags_proxy_level wanted, pags_proxy_mesh *out, pags_proxy_level *level,
                                   const char **note);

#ifdef __cplusplus
}
#endif
#endif
