/* SPDX-License-Identifier: Apache-2.0 */
/* The measurements behind `pags-bench`. Each prints a table for people and puts an object for machines.
 *
 * Times are minima over repetitions: what the machine can do when nothing else disturbs it. */
#ifndef PAGS_BENCHMARKS_BENCH_H
#define PAGS_BENCHMARKS_BENCH_H

#include <pags/dataset.h>
#include <pags/frame.h>
#include <pags/train.h>
#include <stdio.h>
#include "base/json.h"

/* A scene from some cameras. */
typedef struct pags_bench_view {
  pags_tasks *tasks;
  const pags_part *parts;
  int part_count;
  const pags_camera *cameras;
  int camera_count;
  pags_frame_options options;
  int repetitions; /* frames per camera that times are taken over, >= 1 */
  /* Of pags_bench_error alone. */
  const char *name;       /* of the scene */
  const pags_camera *all; /* all cameras of training, of the same size; all_count 0: `cameras` */
  int64_t all_count;
  const char *markdown;       /* file for the table; NULL: none */
  pags_progress_fn *progress; /* may be NULL */
  void *progress_user;
} pags_bench_view;

enum { PAGS_BENCH_ERROR_PARTS = 64 };

/* Sums over the cameras of per-stage minima and of counts. */
typedef struct pags_bench_frame {
  pags_frame_stats stats; /* ms are per frame on average over the cameras, counts likewise */
  double pixels;
  double clusters;
  size_t bytes; /* held by the frame */
} pags_bench_frame;

/* Renders each camera and, with `backward`, sends a gradient back. Pairs are counted in a frame whose time isn't taken.
 */
pags_result pags_bench_measure(const pags_bench_view *view, int backward, pags_bench_frame *out);

/* ns and bytes per Gaussian, pair and pixel of each stage, forward and backward. */
pags_result pags_bench_stages(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Peak blended pairs of the bare kernel, read bandwidth, and the share that raster and its backward reach, for each
 * instruction set that runs here. */
pags_result pags_bench_roofline(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Largest and mean error of each approximation of the engine, by the double-precision oracle or by the engine without
 * it, and what it saves. At most PAGS_BENCH_ERROR_PARTS models. */
pags_result pags_bench_error(const pags_bench_view *view, FILE *people, pags_json_writer *json);

/* Trains, with held-out PSNR against seconds of training every `snapshot_every` steps, and ends with the roofline of
 * what was trained. `options` is complete but for snapshots. */
pags_result pags_bench_train(const pags_train_config *config, const pags_train_options *options, int64_t snapshot_every,
                             FILE *people, pags_json_writer *json);

#endif
