/* SPDX-License-Identifier: Apache-2.0 */
/* The measurements of pags-bench. Each prints a table for people and writes members into an open JSON object.
 *
 * Times are minima over repetitions, which is what the machine can do when nothing else disturbs it. */
#ifndef PAGS_BENCHMARKS_BENCH_H
#define PAGS_BENCHMARKS_BENCH_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/train.h>
#include <stdio.h>
#include "base/json.h"

/* A scene and the cameras that it is measured from. */
typedef struct pags_bench_view {
  pags_tasks *tasks;
  const pags_part *parts;
  int part_count;
  const pags_camera *cameras;
  int camera_count;
  pags_frame_options options;
  int repetitions;     /* timed frames per camera, >= 1 */
  const char *picture; /* file that pags_bench_reference writes */
} pags_bench_view;

/* Times and counts of a frame, averaged over the cameras; each time is the minimum over the repetitions. */
typedef struct pags_bench_frame {
  pags_frame_stats stats; /* milliseconds and counts per frame, mean over the cameras */
  double pixels;
  double clusters;
  size_t bytes; /* memory that the frame holds */
} pags_bench_frame;

/* Renders each camera `repetitions` times and, with `backward`, runs the backward pass with a gradient of the size
 * that a loss gives. Pairs are counted in an extra frame that isn't timed. */
pags_result pags_bench_measure(const pags_bench_view *view, int backward, pags_bench_frame *out);

/* Bytes of each stage of a frame, forward and backward, as a machine without caches would move them. */
enum { PAGS_BENCH_BYTE_STAGES = 8 };
typedef struct pags_bench_stage_bytes {
  const char *stage;
  double bytes;
} pags_bench_stage_bytes;

/* Fills the bytes of the stages; returns how many. */
int pags_bench_bytes_of(const pags_bench_frame *frame, int sh_degree,
                        pags_bench_stage_bytes bytes[PAGS_BENCH_BYTE_STAGES]);

/* Milliseconds of each stage, forward and backward, and nanoseconds and bytes per unit of its work (Gaussian, pair,
 * pixel pair). */
pags_result pags_bench_stages(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Roofline for each instruction set that runs here: pairs per second of the bare blending kernel, memory read
 * bandwidth, and the share of the kernel's speed that the raster stage and its backward pass reach. */
pags_result pags_bench_roofline(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Draws the first camera's view in double precision and writes view->picture, a PFM: three channels of 32-bit floats,
 * rows from below. */
pags_result pags_bench_reference(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Draws a picture in double precision, without exposure: *rgb receives three planes of width x height, which the caller
 * frees, and *pairs the number of pairs of Gaussian and pixel blended. The parts must not be packed. */
pags_result pags_bench_exact(const pags_part *parts, int part_count, const pags_camera *camera,
                             const pags_frame_options *options, double **rgb, int64_t *pairs);

/* Trains and measures held-out PSNR every `snapshot_every` steps; reports PSNR against training time, then stages and
 * roofline of the trained Gaussians. `options` is complete except for the snapshot members, which are set here. */
pags_result pags_bench_train(const pags_train_config *config, const pags_train_options *options, int64_t snapshot_every,
                             FILE *people, pags_json_writer *json);

#endif
