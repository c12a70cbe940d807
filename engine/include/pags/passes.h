/* SPDX-License-Identifier: Apache-2.0 */
/* Passes of a rendered frame for compositing: Cryptomattes, expected normals and motion vectors.
 *
 * They are weighted means with the weights w = alpha T that the picture itself was blended with (pags/frame.h). They
 * are computed by a second walk through the tiles' lists, after the picture, and cost nothing in frames without them.
 * All results are the same bits for any number of threads. */
#ifndef PAGS_PASSES_H
#define PAGS_PASSES_H

#include <pags/base.h>
#include <pags/camera.h>
#include <pags/frame.h>
#include <pags/scene.h>

PAGS_BEGIN_C

/* ---- Requests ---- */

enum { PAGS_MATTE_RANKS = 6, PAGS_MATTE_PLANES = 2 * PAGS_MATTE_RANKS };

/* A Cryptomatte (Friedman and Jones 2015): each part has a name, and each pixel gets the names of the largest sums of
 * weights. Parts may share a name. */
typedef struct pags_matte {
  int32_t name_count;
  const float *values;         /* [name_count]: the names' values in the pass, from pags_cryptomatte_value */
  const int32_t *name_of_part; /* of each part of the frame: index of its name; -1: it has none */
} pags_matte;

/* Poses of the camera and the parts at another time. A part of the frame is found here as the k-th part with the same
 * `gaussians`, where it is the k-th with these in the frame; one that isn't found stays where it is in the frame. */
typedef struct pags_moment {
  pags_camera camera;     /* absolute */
  const pags_part *parts; /* only `gaussians` and `world_from_model` are read */
  int part_count;
} pags_moment;

typedef struct pags_pass_request {
  const pags_matte *matte[2];        /* NULL: not wanted */
  int normal;                        /* 1: expected normals */
  int motion;                        /* 1: motion vectors */
  int pairs;                         /* 1: number of Gaussians per pixel, blended and computed */
  const pags_moment *before, *after; /* of motion vectors; NULL: nothing moves on that side */
} pags_pass_request;

/* ---- Results ---- */

/* Planes with the stride and padding of the frame's picture, owned by the frame and valid until its next render. NULL
 * if not requested. */
typedef struct pags_passes {
  /* Plane 2 k: the value of the name with the k-th largest sum of weights; plane 2 k + 1: that sum, 0..1. For equal
   * sums the smaller index of the name comes first. Ranks that no name has are 0. */
  const float *matte[2][PAGS_MATTE_PLANES];
  /* sum(w n) / sum(w) in world axes; 0 where nothing is blended. n is the unit vector along the Gaussian's shortest
   * axis (the first of equal ones), as a normal of what the part's pose stretches, that faces the camera. The mean is
   * shorter than 1 where directions differ. */
  const float *normal[3];
  /* Blender's Vector pass, pixels, x to the right and y upwards: the position `before` minus the present position of
   * the visible point (0, 1), and the present position minus the position `after` (2, 3). It is sum(w m) + T m_sky,
   * with m the motion of the point on the pixel's ray at the Gaussian's depth, which its part and the camera carry, and
   * m_sky that of a point infinitely far away. Points behind the other camera add 0. */
  const float *motion[4];
  /* Cost of the pixel: number of Gaussians blended into it (0) and for which alpha was computed there (1); the rest of
   * the latter are too faint at the pixel or behind the point where it stopped. The latter is the same for all pixels
   * of a block of 4x4, the granularity of the rasteriser. */
  const float *pairs[2];
} pags_passes;

/* Computes passes of the last render, which must have had options.keep_for_passes. PAGS_ERROR_MEMORY;
 * PAGS_CANCELLED. */
PAGS_API pags_result pags_frame_passes(pags_frame *frame, const pags_pass_request *request, pags_passes *out);

/* ---- Names ---- */

/* The hash of a name of `length` bytes in the Cryptomatte specification 1.2 and in Blender: 32-bit MurmurHash3 (Austin
 * Appleby, public domain) with seed 0. */
PAGS_API uint32_t pags_cryptomatte_hash(const char *name, size_t length);

/* The hash as a float, by the specification's conversion uint32_to_float32: the same bits, but exponents of denormal
 * numbers become 1 and those for infinity and NaN 254. */
PAGS_API float pags_cryptomatte_value(uint32_t hash);

/* The names of a matte. Labels with the same text share a name. */
typedef struct pags_matte_names {
  int32_t count;
  char **names;  /* ascending, all different */
  float *values; /* of each name, as pags_matte has it */
  int64_t label_count;
  int32_t *name_of_label; /* index of each label's name */
  char *manifest;         /* JSON: each name with its hash in hexadecimal digits, as in the specification */
} pags_matte_names;

/* Makes the list of the labels' names. PAGS_ERROR_MEMORY; then `out` is zeroed. */
PAGS_API pags_result pags_matte_names_create(const char *const *labels, int64_t label_count, pags_matte_names *out);

/* The same of a scene: label i is object i, by its id or (classes = 1) by its class; one more label, the last, is
 * "background", for what belongs to no object. */
PAGS_API pags_result pags_matte_names_of_scene(const pags_scene *scene, int classes, pags_matte_names *out);

/* Frees the names and zeroes the struct. A zeroed struct is allowed. */
PAGS_API void pags_matte_names_destroy(pags_matte_names *names);

PAGS_END_C
#endif
