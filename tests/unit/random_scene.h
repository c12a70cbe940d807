/* SPDX-License-Identifier: Apache-2.0 */
/* A random scene, its camera and loss, and an engine to draw it with, for tests of a whole frame. An error inside
 * these functions fails the test. */
#ifndef PAGS_TESTS_UNIT_RANDOM_SCENE_H
#define PAGS_TESTS_UNIT_RANDOM_SCENE_H

#include "reference/frame_scene.h"
#include "reference/reference_scene.h"

enum { WIDTH = 101, HEIGHT = 67, PIXELS = WIDTH * HEIGHT };

typedef struct fixture {
  reference_random random;
  pags_camera camera;
  pags_frame_options options;
  reference_part part;
  double *weights; /* weights of the loss on the picture's five planes */
  float sky_cut;
} fixture;

typedef struct engine {
  pags_tasks *tasks;
  pags_frame *frame;
} engine;

/* Creates `count` random Gaussians of degree 3 in front of a random camera; the frame options ask for every output. */
fixture fixture_create(uint64_t seed, int64_t count);
void fixture_destroy(fixture *f);
/* Returns the address of parameter plane `plane` of Gaussian i. */
double *fixture_at(fixture *f, int plane, int64_t i);

engine engine_create(int threads);
void engine_destroy(engine *e);

/* Renders the frame and computes its gradients (forward and backward pass). */
frame_result fixture_run(engine *e, const fixture *f, int cluster_size, uint64_t shuffle_seed);
/* Like fixture_run, with an engine of two threads; also asserts that the picture and all gradients are finite. */
frame_result fixture_run_finite(const fixture *f);
int fixture_is_background(const fixture *f, const frame_result *result);

#endif
