/* SPDX-License-Identifier: Apache-2.0 */
/* Runs the engine's frame on the oracle's data, with the same Gaussians in float. Pictures and gradients are
 * returned without padding. An error of the engine fails the running cmocka test. */
#ifndef PAGS_TESTS_FRAME_SCENE_H
#define PAGS_TESTS_FRAME_SCENE_H

#include "reference/reference.h"

enum { FRAME_SCENE_PARTS = 4 };

typedef struct frame_scene {
  int part_count;
  pags_part parts[FRAME_SCENE_PARTS];
  pags_gaussians gaussians[FRAME_SCENE_PARTS];
  pags_clusters clusters[FRAME_SCENE_PARTS];
  int32_t *id[FRAME_SCENE_PARTS];     /* NULL: ids are first_id + row */
  int64_t *source[FRAME_SCENE_PARTS]; /* row of the reference part that each row came from */
  /* SH coefficients, if the reference part has separate ones: NaN until the cluster is touched, then `sh_values`. */
  float *sh[FRAME_SCENE_PARTS];
  float *sh_values[FRAME_SCENE_PARTS];
  float *factor[FRAME_SCENE_PARTS]; /* opacity factors, if the reference part has them */
  float sky_cut;                    /* sky_cut of the backward pass */
} frame_scene;

/* Rounds the parts' values to float. `shuffle_seed` != 0: rows in a random order, their ids given explicitly. */
frame_scene frame_scene_create(const reference_part *parts, int part_count, int cluster_size, uint64_t shuffle_seed);
void frame_scene_destroy(frame_scene *scene);

/* Rounds the values of a reference part to float in place, so that engine and oracle start from the same numbers. */
void frame_scene_round(reference_part *part);

typedef struct frame_part_result { /* results by row of the reference part, however the rows were shuffled */
  int64_t count;
  int plane_count;
  float *planes; /* dL/d raw parameters, plane p of row i at p * count + i */
  float *mean2d, *radius;
  uint8_t *drawn;
  int64_t cluster_count;
  uint8_t *touched, *received; /* number of callback calls for each cluster */
} frame_part_result;

typedef struct frame_result {
  int width, height, part_count;
  float *rgb;                               /* three planes */
  float *transmittance, *depth, *depth_sum; /* depths and id only with extra_channels */
  int32_t *id;
  int64_t sky_floats;
  float *sky;          /* gradient of the texels, if there is a sky and a backward pass */
  uint8_t *sky_blocks; /* which blocks of the sky's gradient were written */
  frame_part_result parts[FRAME_SCENE_PARTS];
  int64_t bad_rows;
} frame_result;

/* Renders the scene and, if `gradient` isn't NULL, runs the backward pass: keep_for_backward is then set, and
 * depth_sum if the loss uses depth. */
frame_result frame_run(pags_frame *frame, const frame_scene *scene, const pags_camera *camera,
                       const pags_frame_options *options, const reference_picture_gradient *gradient);
void frame_result_destroy(frame_result *result);

/* Returns whether every float of the result is finite. */
int frame_result_finite(const frame_result *result);
/* 64-bit hash of all bits that a caller can see, gradients included. */
uint64_t frame_result_hash(const frame_result *result);

#endif
