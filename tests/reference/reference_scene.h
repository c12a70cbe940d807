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

/* A camera of width x height pixels with a field of view of about 60 degrees, at a random place within 3 m of the
 * origin and with a random orientation. */
pags_camera reference_random_camera(reference_random *random, int width, int height);

/* A random rigid motion with translations up to `reach` metres an axis. */
void reference_random_pose(reference_random *random, double reach, double pose[12]);

typedef struct reference_recipe {
  double depth[2];   /* metres, range */
  double spread;     /* means lie in the picture scaled by this factor around its centre; 1: in the picture */
  double sigma[2];   /* px, range of the larger axes on the picture, log-uniform */
  double anisotropy; /* largest sigma over smallest; ratio is log-uniform in [1, anisotropy] */
  double logit[2];   /* range of the opacity's logit */
  double colour;     /* standard deviation of the SH coefficients */
} reference_recipe;

reference_recipe reference_recipe_default(void);

/* Writes row i of `part`, a random Gaussian which the camera (in world coordinates) sees as the recipe states. */
void reference_random_gaussian(reference_random *random, const reference_recipe *recipe, const pags_camera *camera,
                               const pags_frame_options *options, reference_part *part, int64_t i);

/* Stretches the part's pose along the axes of its model by `factor` (negative: mirrors) and moves its means so that
 * they stay where they are in the world. */
void reference_stretch(reference_part *part, const double factor[3]);

/* Gives the part separate constant SH terms, which replace those of its planes. */
void reference_random_sh(reference_random *random, reference_part *part);

/* A cube map of random values in [0, 1]; the caller frees its texels. */
pags_sky reference_random_sky(reference_random *random, int size);

/* The values of pags_frame_options_default, without linking the engine. */
pags_frame_options reference_options(void);

#endif
