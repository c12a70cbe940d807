/* SPDX-License-Identifier: Apache-2.0 */
/* Random cameras and Gaussians for the tests that compare with the oracle. Everything follows from the seed. */
#ifndef PAGS_TESTS_REFERENCE_SCENE_H
#define PAGS_TESTS_REFERENCE_SCENE_H

#include "reference/reference.h"

typedef struct reference_random {
  uint64_t state;
} reference_random;

double reference_uniform(reference_random *random, double lo, double hi);
double reference_normal(reference_random *random);

/* A camera of that many pixels, field of view about 60 degrees, somewhere within 3 m of the origin, looking anywhere.
 */
pags_camera reference_random_camera(reference_random *random, int width, int height);

/* A random rigid motion with translations up to `reach` metres an axis. */
void reference_random_pose(reference_random *random, double reach, double pose[12]);

typedef struct reference_recipe {
  double depth[2];   /* metres, range */
  double spread;     /* means lie in the picture widened by this factor; 1: in the picture */
  double sigma[2];   /* px, range of the larger axes on the picture, log-uniform */
  double anisotropy; /* largest sigma over smallest; ratio is log-uniform in [1, anisotropy] */
  double logit[2];   /* of the opacity, range */
  double colour;     /* standard deviation of the SH coefficients */
} reference_recipe;

reference_recipe reference_recipe_default(void);

/* Writes row i of `part` so that the camera, standing in the world, sees it as the recipe says. */
void reference_random_gaussian(reference_random *random, const reference_recipe *recipe, const pags_camera *camera,
                               const pags_frame_options *options, reference_part *part, int64_t i);

/* Gives the part a constant SH term of its own. */
void reference_random_dc(reference_random *random, reference_part *part);

/* A cube map of noise in [0, 1]; free its texels. */
pags_sky reference_random_sky(reference_random *random, int size);

/* pags_frame_options_default without linking the engine. */
pags_frame_options reference_options(void);

#endif
