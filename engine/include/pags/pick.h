/* SPDX-License-Identifier: Apache-2.0 */
/* Picking: which Gaussian, and which object, a ray hits.
 *
 * Along the ray o + t d the density of a Gaussian is largest at one t. The ray hits the Gaussian there with
 *
 *     alpha = min(0.99, opacity * exp(-m^2 / 2))
 *
 * where m is the distance of the ray from the mean in sigmas (Mahalanobis distance). A Gaussian is missed if alpha
 * is below 1/255 or t lies outside of nearest..farthest. The hits are visited by ascending t and blended front to
 * back: each leaves 1 - alpha of the ray. The picked Gaussian is the one after which at least the share `blocked` of
 * the ray is used up. A value of 0 picks the nearest hit, however faint; the default of 1/2 passes over floaters and
 * picks what is visible there. The alpha of a drawn picture differs only by the low-pass filter, which widens
 * Gaussians smaller than a pixel.
 *
 * Clusters whose bounds the ray misses are never read. Any number of threads may pick from the same parts at
 * once. */
#ifndef PAGS_PICK_H
#define PAGS_PICK_H

#include <pags/base.h>
#include <pags/compose.h>
#include <pags/frame.h>

PAGS_BEGIN_C

typedef struct pags_pick_options {
  double origin[3]; /* origin of the parts' positions, metres, as in pags_frame_options; default 0 */
  double nearest;   /* hits with a smaller t are ignored, >= 0; default 0 */
  double farthest;  /* hits with a larger t are ignored; default infinity */
  double blocked;   /* share of the ray that the picked Gaussian and those before it use up, 0..1; default 1/2 */
} pags_pick_options;

PAGS_API pags_pick_options pags_pick_options_default(void);

typedef struct pags_picked {
  int part;               /* index of the part; -1: nothing is hit, and all other members are undefined */
  int64_t row;            /* row of the Gaussian in that part */
  int32_t id;             /* id of the Gaussian, as in pags_picture.id */
  double depth;           /* t, in multiples of the direction's length: camera z if the direction's camera z is 1 */
  double point[3];        /* o + t d, world, metres */
  double alpha;           /* alpha of this Gaussian alone */
  double blocked;         /* share of the ray that is used up after this Gaussian */
  int64_t object;         /* index of the object in the scene; -1: none, or unknown */
  const char *class_name; /* the object's class as the data set spells it ("Car"), owned by the scene; NULL: none */
  const char *object_id;  /* the id of the object's track, owned by the scene; NULL: none */
  int critical;           /* 1: the object is critical */
} pags_picked;

/* Picks from `parts`. `origin` and `direction` of the ray are in absolute world coordinates (metres); the
 * direction may have any length > 0. `options` may be NULL (the defaults). Hitting nothing is not an error.
 * out->object is set if the Gaussians of the part carry an object_id (packed parts don't); class_name, object_id
 * and critical are not set. PAGS_ERROR_ARGUMENT for a direction of length 0 or values that are not finite;
 * PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_pick(const pags_part *parts, int part_count, const double origin[3],
                               const double direction[3], const pags_pick_options *options, pags_picked *out);

/* Picks, as pags_pick does, from parts that pags_compose or pags_compose_placed returned for this composition,
 * and sets every member of the object that is hit. The scene's origin replaces options->origin. `options` may be
 * NULL. */
PAGS_API pags_result pags_composition_pick(const pags_composition *composition, const pags_part *parts, int part_count,
                                           const double origin[3], const double direction[3],
                                           const pags_pick_options *options, pags_picked *out);

PAGS_END_C
#endif
