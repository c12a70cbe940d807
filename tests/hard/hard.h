/* SPDX-License-Identifier: Apache-2.0 */
/* Fixtures of the hard cases (docs/lab/numerics.md): a picture held to the oracle, forward and backward, and a small
 * data set to train on. What isn't finite, or fails in the engine, fails the running cmocka test. */
#ifndef PAGS_TESTS_HARD_H
#define PAGS_TESTS_HARD_H

#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <pags/train.h>

/* Pictures: a camera at the world's origin that looks along z, and one part. */

enum { HARD_WIDTH = 96, HARD_HEIGHT = 64, HARD_PIXELS = HARD_WIDTH * HARD_HEIGHT };
#define HARD_FOCAL 80.0

typedef struct hard_scene {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
  uint8_t *hidden;        /* per row, 1: the oracle doesn't draw it; zeros */
  pags_frame_stats stats; /* of the last hard_run */
} hard_scene;

/* `count` rows of which all are ordinary Gaussians in the picture, degree 3. */
hard_scene hard_scene_create(uint64_t seed, int64_t count);
void hard_scene_destroy(hard_scene *scene);
double *hard_at(hard_scene *scene, int plane, int64_t row);
/* A ball. */
void hard_put(hard_scene *scene, int64_t row, double x, double y, double z, double sigma, double logit);

/* Picture and gradients, two threads; everything that comes out is finite. `weights` of the loss: five planes, or NULL.
 */
frame_result hard_run(hard_scene *scene, const double *weights);

typedef struct hard_error {
  double colour;     /* largest of the picture's channels and transmittance, where float can't decide otherwise */
  double gradient;   /* largest over rows and groups of parameters: |difference| / max(|exact|, 1 % of the group's root
                        mean square) */
  double left_out;   /* share of pixels where float may decide otherwise */
  int64_t drawn;     /* rows, by the oracle */
  int64_t disagreed; /* rows that only one of the two draws */
} hard_error;

/* The engine against the oracle, whose values are rounded to float first. */
hard_error hard_compare(hard_scene *scene);
/* Compares, prints one line and asserts the bounds and that the two draw the same rows. */
hard_error hard_expect(const char *what, hard_scene *scene, double colour, double gradient);

/* Training: views on a circle of radius 4 that look at the origin, of `TRUTH` Gaussians in [-1, 1]^3. */

enum { HARD_VIEWS = 6, HARD_VIEW_WIDTH = 64, HARD_VIEW_HEIGHT = 48, HARD_TRUTH = 120, HARD_STEPS = 200 };
#define HARD_VIEW_FOCAL 64.0

typedef struct hard_points { /* of points.ply; count 0: none is written and the reader takes random ones */
  int64_t count;
  const float *xyz;
  const uint8_t *rgb; /* NULL: grey */
} hard_points;

typedef struct hard_data_options {
  double scale;     /* of the whole world; 0: 1 */
  double offset[3]; /* added to all coordinates, metres */
  int views;        /* 0: HARD_VIEWS */
  hard_points points;
  int level; /* photographs of one 16-bit level instead of pictures; -1: pictures */
} hard_data_options;
#define HARD_DATA_DEFAULT ((hard_data_options){.level = -1})

/* Whether HARD_SHORT is set, as it is where a program is run once more for each instruction set: then a case that takes
 * long prints that it is left out (a case does so by itself). */
int hard_leaves_out(void);

/* Set-up and tear-down of a group of tests that use data sets: a scratch folder. */
int hard_begin(void **state);
int hard_end(void **state);
/* A path in it, good until the fourth call from now. */
const char *hard_path(const char *name);

/* What the photographs show. */
void hard_truth(pags_gaussians *truth);
/* Writes photographs and transforms.json into hard_path(name) and opens it. Without `points` the rows of the truth are
 * the points. */
pags_dataset *hard_data(const char *name, const hard_data_options *options);

/* Few Gaussians, full size from the first step, densification, no reset. */
pags_train_config hard_config(int64_t steps);
/* A run into hard_path(name). `start`, when not NULL, takes the place of what the run would start from (degree
 * config->color.sh_degree). */
pags_result hard_try(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                     const pags_gaussians *start, int threads, pags_train_options options, pags_train_result *result);
/* The same with two threads, which must succeed and leave a finite scene. */
pags_train_result hard_train(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                             const pags_gaussians *start);
/* Fails unless every number of the scene in hard_path(name) is finite; returns its Gaussians. */
int64_t hard_check_scene(const char *name);

#endif
