/* SPDX-License-Identifier: Apache-2.0 */
/* Picking: which Gaussian a ray meets.
 *
 * Along the ray o + t d a Gaussian's density is largest at one t, where alpha = min(0.99, opacity * exp(-m^2 / 2)), m
 * being the ray's distance from the middle in sigmas. There the ray meets it; under 1/255, or at t below the options'
 * nearest, it doesn't. Gaussians met are gone through by t, each leaving 1 - alpha of the ray; picked is the one by
 * which at least `blocked` of the ray is gone. With blocked = 0 that is the nearest of all, however faint; with the
 * default, 1/2, what one would say is seen there, floaters passed over. The picture's alpha differs by the low-pass
 * alone, which widens what is smaller than a pixel.
 *
 * Clusters whose boxes the ray passes by are never read. Any number of threads may pick from the same parts at once. */
#ifndef PAGS_PICK_H
#define PAGS_PICK_H

#include <pags/base.h>
#include <pags/compose.h>
#include <pags/frame.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pags_pick_options {
  double origin[3]; /* of the parts' positions, metres, as pags_frame_options has it; default 0 */
  double nearest;   /* t below which nothing is met, >= 0; default 0 */
  double farthest;  /* and beyond which; default infinite */
  double blocked;   /* share of the ray, 0..1; default 1/2 */
} pags_pick_options;

PAGS_API pags_pick_options pags_pick_options_default(void);

typedef struct pags_picked {
  int part;        /* index; -1: nothing is met, the rest of this means nothing then */
  int64_t row;     /* of that part's Gaussians */
  int32_t id;      /* as pictures have it */
  double depth;    /* t, in lengths of the direction: camera z for a direction whose z in the camera's axes is 1 */
  double point[3]; /* o + t d */
  double alpha;    /* of this Gaussian */
  double blocked;  /* share of the ray that is gone with it */
  int64_t object;  /* index of the scene's object; -1: none, or not known */
  const char *class_name; /* "Car", ... as the data set has it; NULL: none. The scene's */
  const char *object_id;  /* its track's name; NULL: none. The scene's */
  int critical;
} pags_picked;

/* Origin and direction in the world; the direction need not be of unit length. Where nothing is met that is no error.
 * The object is set where the part's Gaussians carry an object_id, its class and name are not. PAGS_ERROR_ARGUMENT for
 * a direction of no length or values that are not finite; PAGS_ERROR_MEMORY. */
PAGS_API pags_result pags_pick(const pags_part *parts, int part_count, const double origin[3],
                               const double direction[3], const pags_pick_options *options, pags_picked *out);

/* The same of parts that pags_compose or pags_compose_placed gave, with everything known of the object; the scene's
 * origin is put in for the options'. `options` may be NULL. */
PAGS_API pags_result pags_composition_pick(const pags_composition *composition, const pags_part *parts, int part_count,
                                           const double origin[3], const double direction[3],
                                           const pags_pick_options *options, pags_picked *out);

#ifdef __cplusplus
}
#endif
#endif
