/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench roofline: compares the raster stage and its backward pass with the speed of the bare blending kernel,
 * and measures the memory's read bandwidth.
 *
 * The bare kernel is the rasteriser's own step, with the per-pixel stop, on splats in registers: no lists, no loads,
 * no tiles. Kernel and frames are timed alternately, so that a machine that changes its clock rate changes both. */
#include "benchmarks/bench.h"

#include <stdlib.h>
#include <string.h>
#include "base/clock.h"
#include "base/text.h"
#include "benchmarks/threads/pool_costs.h"
#include "port/port.h"

enum { ROUNDS = 5 };

typedef struct share {
  double peak, forward, backward; /* pixel pairs evaluated per second */
  double blended;                 /* share of the evaluated pairs that are blended */
  double ratio;                   /* time of the backward pass divided by that of the forward pass */
  double raster_ms, backward_ms;
} share;

static pags_result measure_isa(const pags_bench_view *view, const pags_kernels *kernels, share *out) {
  memset(out, 0, sizeof *out);
  pags_port_set_environment("PAGS_CPU", kernels->name); /* pags_frame_create chooses its kernels by this variable */
  pags_bench_view once = *view;
  once.repetitions = (view->repetitions + ROUNDS - 1) / ROUNDS;
  for (int round = 0; round < ROUNDS; round++) {
    const double peak = pags_peak_rate(view->tasks, kernels, 5);
    pags_bench_frame frame;
    PAGS_TRY(pags_bench_measure(&once, 1, &frame));
    const double pairs = (double)frame.stats.pairs_evaluated;
    const double forward = pairs / frame.stats.ms_raster * 1e3, backward = pairs / frame.stats.ms_raster_backward * 1e3;
    out->peak = peak > out->peak ? peak : out->peak;
    out->forward = forward > out->forward ? forward : out->forward;
    out->backward = backward > out->backward ? backward : out->backward;
    out->blended = pairs > 0 ? (double)frame.stats.pairs_blended / pairs : 0;
    out->raster_ms = pairs / out->forward * 1e3;
    out->backward_ms = pairs / out->backward * 1e3;
  }
  out->ratio = out->forward / out->backward;
  return PAGS_OK;
}

pags_result pags_bench_roofline(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  static const char *const names[] = {"avx512", "avx2", "neon", "scalar"};
  const char *const set = getenv("PAGS_CPU");
  char *const before = set ? pags_text_copy(set) : NULL;
  const double bandwidth = pags_read_bandwidth(view->tasks);
  pags_json_begin_object(json, "roofline");
  pags_json_put_integer(json, "threads", pags_tasks_workers(view->tasks));
  pags_json_put_number(json, "read_bytes_per_second", bandwidth);
  if (people) {
    fprintf(people, "%d threads; memory is read at %.1f GB/s. Pixel pairs evaluated, thousand million a second:\n",
            pags_tasks_workers(view->tasks), bandwidth * 1e-9);
    fprintf(people, "%-8s %9s %9s %9s %9s %9s %10s %11s\n", "kernels", "bare", "raster", "share", "backward", "share",
            "back/forth", "blended");
  }
  pags_result result = PAGS_OK;
  double wide = 0, narrow = 0;
  for (size_t i = 0; i < sizeof names / sizeof *names && result == PAGS_OK; i++) {
    const pags_kernels *const kernels = pags_kernels_named(names[i]);
    if (!kernels || (before && strcmp(before, names[i]) != 0))
      continue;
    share s;
    result = measure_isa(view, kernels, &s);
    if (result != PAGS_OK)
      break;

    /* Write and print the instruction set's figures. */
    pags_json_begin_object(json, names[i]);
    pags_json_put_number(json, "peak_pairs_per_second", s.peak);
    pags_json_put_number(json, "raster_pairs_per_second", s.forward);
    pags_json_put_number(json, "raster_share", s.forward / s.peak);
    pags_json_put_number(json, "backward_pairs_per_second", s.backward);
    pags_json_put_number(json, "backward_share", s.backward / s.peak);
    pags_json_put_number(json, "backward_over_forward", s.ratio);
    pags_json_put_number(json, "blended_over_evaluated", s.blended);
    pags_json_put_number(json, "raster_ms", s.raster_ms);
    pags_json_put_number(json, "raster_backward_ms", s.backward_ms);
    pags_json_end_object(json);
    if (people)
      fprintf(people, "%-8s %9.2f %9.2f %7.0f %% %9.2f %7.0f %% %10.2f %9.0f %%\n", names[i], s.peak * 1e-9,
              s.forward * 1e-9, 100 * s.forward / s.peak, s.backward * 1e-9, 100 * s.backward / s.peak, s.ratio,
              100 * s.blended);

    wide = strcmp(names[i], "avx512") == 0 ? s.forward : wide;
    narrow = strcmp(names[i], "avx2") == 0 ? s.forward : narrow;
  }
  if (wide > 0 && narrow > 0) {
    pags_json_put_number(json, "avx512_over_avx2", wide / narrow);
    if (people)
      fprintf(people, "raster on AVX-512 is %.2f times as fast as on AVX2\n", wide / narrow);
  }
  pags_json_end_object(json);
  if (before)
    pags_port_set_environment("PAGS_CPU", before);
  else
    pags_port_set_environment("PAGS_CPU", NULL);
  free(before);
  return result;
}
