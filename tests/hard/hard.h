/* SPDX-License-Identifier: Apache-2.0 */
/* Fixtures of the hard cases (docs/lab/numerics.md, whose numbers the tests quote): pictures and gradients compared
 * with the oracle, and a small data set to train on. Results that aren't finite and errors of the engine fail the
 * running cmocka test. */
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

/* ---- Pictures: a camera at the world's origin that looks along z, and one part ---- */

enum { HARD_WIDTH = 96, HARD_HEIGHT = 64, HARD_PIXELS = HARD_WIDTH * HARD_HEIGHT };
#define HARD_FOCAL 80.0

typedef struct hard_scene {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
  uint8_t *hidden;        /* for each row, 1: the oracle doesn't draw it; initially zeros */
  pags_frame_stats stats; /* statistics of the last hard_run */
} hard_scene;

/* A scene of `count` ordinary Gaussians of degree 3 in the picture. */
hard_scene hard_scene_create(uint64_t seed, int64_t count);
void hard_scene_destroy(hard_scene *scene);
double *hard_at(hard_scene *scene, int plane, int64_t row);
/* Writes a round Gaussian into a row. */
void hard_put(hard_scene *scene, int64_t row, double x, double y, double z, double sigma, double logit);

/* Renders the picture and its gradients with two threads and asserts that all results are finite. `weights` of the
 * loss: five planes, or NULL. */
frame_result hard_run(hard_scene *scene, const double *weights);

typedef struct hard_error {
  /* Largest error of colour channels and transmittance, over pixels where rounding can't change a decision. */
  double colour;
  double gradient;   /* largest over rows and groups of parameters: |difference| / max(|exact|, 1 % of the group's root
                        mean square) */
  double left_out;   /* share of pixels where rounding may change a decision */
  int64_t drawn;     /* number of rows that the oracle draws */
  int64_t disagreed; /* number of rows that only engine or oracle draws */
} hard_error;

/* Compares the engine with the oracle, whose parameters are rounded to float first. */
hard_error hard_compare(hard_scene *scene);
/* Compares, prints one line, and asserts the bounds and that engine and oracle draw the same rows. */
hard_error hard_expect(const char *what, hard_scene *scene, double colour, double gradient);

/* ---- Training: views on a circle of radius 4 that look at the origin, of HARD_TRUTH Gaussians in [-1, 1]^3 ---- */

enum { HARD_VIEWS = 6, HARD_VIEW_WIDTH = 64, HARD_VIEW_HEIGHT = 48, HARD_TRUTH = 120, HARD_STEPS = 200 };
#define HARD_VIEW_FOCAL 64.0

/* Contents of points.ply; count 0: no file is written and the reader makes random points. */
typedef struct hard_points {
  int64_t count;
  const float *xyz;
  const uint8_t *rgb; /* NULL: grey */
} hard_points;

typedef struct hard_data_options {
  double scale;     /* factor on the whole world; 0: 1 */
  double offset[3]; /* added to all coordinates, metres */
  int views;        /* 0: HARD_VIEWS */
  hard_points points;
  int level; /* grey level of all photographs, 16 bits; -1: photographs of the scene */
} hard_data_options;
#define HARD_DATA_DEFAULT ((hard_data_options){.level = -1})

/* Returns whether HARD_SHORT is set, as in the runs repeated for each instruction set. Then prints that the test is
 * left out, as it takes long. */
int hard_leaves_out(void);

/* Set-up and tear-down of a group of tests that use data sets: makes and removes a scratch folder. */
int hard_begin(void **state);
int hard_end(void **state);
/* Returns the path of a file in the scratch folder; valid until four more calls. */
const char *hard_path(const char *name);

/* The Gaussians that the photographs show. */
void hard_truth(pags_gaussians *truth);
/* Writes photographs and transforms.json into hard_path(name) and opens the data set. Without `points` the means of
 * the true Gaussians are the points. */
pags_dataset *hard_data(const char *name, const hard_data_options *options);

/* A configuration of few Gaussians, at full picture size from the first step, with densification and without opacity
 * resets. */
pags_train_config hard_config(int64_t steps);
/* Trains into hard_path(name). If `start` isn't NULL, it replaces the run's initial Gaussians (degree
 * config->color.sh_degree). */
pags_result hard_try(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                     const pags_gaussians *start, int threads, pags_train_options options, pags_train_result *result);
/* Like hard_try with two threads; asserts that training succeeds and that the scene is finite. */
pags_train_result hard_train(const pags_dataset *dataset, const char *name, const pags_train_config *config,
                             const pags_gaussians *start);
/* Asserts that every number of the scene in hard_path(name) is finite; returns its number of Gaussians. */
int64_t hard_check_scene(const char *name);

#endif
