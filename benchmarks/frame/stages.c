/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench stages: time and bytes of each stage of a frame per unit of its work (cluster, Gaussian, pair).
 *
 * The bytes are not measured but follow from the stage's data structures: what its own loops read and write, as a
 * machine without caches would move it. */
#include "benchmarks/bench.h"
#include "benchmarks/frame/modes.h"

#include <pags/packed.h>

typedef struct stage_row {
  const char *name, *unit;
  double ms, units, bytes; /* per frame */
} stage_row;

enum { SPLAT = 64, ENTRY = 8, MASK = 2, SLOT = 48, KEY = 4, ROW = 8, BOX = 16, INDEX = 4 };

/* Fills the rows of the stages, six of the forward and two of the backward pass; returns how many. */
static int fill_rows(const pags_frame_stats *s, int degree, double clusters, double pixels, stage_row *rows) {
  const double loaded = (double)s->loaded, drawn = (double)s->shaded, pairs = (double)s->pairs_binned;
  const double geometry = 11 * 4.0, colour = 12.0 * pags_sh_coefficients(degree);
  int n = 0;
  rows[n++] = (stage_row){"cull", "cluster", s->ms_cull, clusters, clusters * 29};
  rows[n++] = (stage_row){"project", "Gaussian loaded", s->ms_project, loaded,
                          loaded * (geometry + KEY) + drawn * (SPLAT + BOX)};
  rows[n++] = (stage_row){"shade", "Gaussian drawn", s->ms_shade, drawn, loaded * KEY + drawn * (colour + 12 + 16)};
  /* Keys are read twice to list the drawn Gaussians; the list is written, then read twice with the boxes; the entries
   * are written. */
  rows[n++] = (stage_row){"bin", "pair of tile", s->ms_bin, pairs,
                          loaded * 2 * KEY + drawn * (3 * INDEX + 2 * BOX) + pairs * (ENTRY + 4)};
  /* Keys are gathered; their digits are counted (read); they are scattered three times (read and written); the
   * entries are read, copied and put in order. */
  rows[n++] =
      (stage_row){"sort", "pair of tile", s->ms_sort, pairs, pairs * (KEY + ROW + ROW + 3 * 2 * ROW + ROW + 4 * ENTRY)};
  rows[n++] = (stage_row){"raster", "pixel pair evaluated", s->ms_raster, (double)s->pairs_evaluated,
                          pairs * (ENTRY + SPLAT) + pixels * 16};
  rows[n++] = (stage_row){"raster backward", "pixel pair evaluated", s->ms_raster_backward, (double)s->pairs_evaluated,
                          pairs * (ENTRY + SPLAT + MASK + SLOT) + pixels * 28};
  rows[n++] = (stage_row){"project backward", "Gaussian loaded", s->ms_project_backward, loaded,
                          pairs * SLOT + loaded * (KEY + SPLAT + 8) + drawn * (geometry + colour)};
  return n;
}

double pags_bench_forward_bytes(const pags_frame_stats *stats, int sh_degree, double clusters, double pixels,
                                int packed) {
  stage_row rows[PAGS_BENCH_BYTE_STAGES];
  double bytes = 0;
  /* bytes saved by packing: 44 bytes of geometry become 21, colours are halves and bytes, means read again take 6 */
  if (packed)
    bytes = -(double)stats->loaded * (44 - 21) -
            (double)stats->shaded * (12.0 * pags_sh_coefficients(sh_degree) + 12 -
                                     ((double)pags_packed_colour_bytes(sh_degree) / PAGS_PACKED_ROWS + 6));
  fill_rows(stats, sh_degree, clusters, pixels, rows);
  for (int i = 0; i < 6; i++)
    bytes += rows[i].bytes;
  return bytes;
}

int pags_bench_bytes_of(const pags_bench_frame *frame, int sh_degree,
                        pags_bench_stage_bytes bytes[PAGS_BENCH_BYTE_STAGES]) {
  stage_row rows[PAGS_BENCH_BYTE_STAGES];
  const int n = fill_rows(&frame->stats, sh_degree, frame->clusters, frame->pixels, rows);
  for (int i = 0; i < n; i++)
    bytes[i] = (pags_bench_stage_bytes){rows[i].name, rows[i].bytes};
  return n;
}

pags_result pags_bench_stages(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  pags_bench_frame frame;
  PAGS_TRY(pags_bench_measure(view, 1, &frame));
  stage_row rows[PAGS_BENCH_BYTE_STAGES];
  int degree = 0;
  for (int p = 0; p < view->part_count; p++)
    degree = view->parts[p].gaussians->sh_degree > degree ? view->parts[p].gaussians->sh_degree : degree;
  degree = view->options.sh_degree < degree ? view->options.sh_degree : degree;
  const int n = fill_rows(&frame.stats, degree, frame.clusters, frame.pixels, rows);
  const pags_frame_stats *const s = &frame.stats;
  pags_json_begin_object(json, "stages");
  if (people)
    fprintf(people, "%-17s %9s %12s  %-21s %9s %9s %8s\n", "stage", "ms", "units", "unit", "ns/unit", "B/unit", "GB/s");
  for (int i = 0; i < n; i++) {
    /* Write the row as JSON. */
    const stage_row *row = rows + i;
    pags_json_begin_object(json, row->name);
    pags_json_put_number(json, "ms", row->ms);
    pags_json_put_string(json, "unit", row->unit);
    pags_json_put_number(json, "units", row->units);
    pags_json_put_number(json, "ns_per_unit", row->units > 0 ? row->ms * 1e6 / row->units : 0);
    pags_json_put_number(json, "bytes_per_unit", row->units > 0 ? row->bytes / row->units : 0);
    pags_json_put_number(json, "gb_per_second", row->ms > 0 ? row->bytes / row->ms * 1e-6 : 0);
    pags_json_end_object(json);

    if (people && rows[i].units > 0)
      fprintf(people, "%-17s %9.3f %12.0f  %-21s %9.3f %9.2f %8.2f\n", rows[i].name, rows[i].ms, rows[i].units,
              rows[i].unit, rows[i].ms * 1e6 / rows[i].units, rows[i].bytes / rows[i].units,
              rows[i].bytes / rows[i].ms * 1e-6);
  }
  pags_json_end_object(json);
  pags_json_put_integer(json, "gaussians", s->gaussians);
  pags_json_put_integer(json, "pairs_binned", s->pairs_binned);
  pags_json_put_integer(json, "pairs_evaluated", s->pairs_evaluated);
  pags_json_put_integer(json, "pairs_blended", s->pairs_blended);
  pags_json_put_number(json, "pixels", frame.pixels);
  pags_json_put_integer(json, "frame_bytes", (int64_t)frame.bytes);
  if (people)
    fprintf(people,
            "per frame, mean of %d views, best of %d: %lld Gaussians, %.0f pixels, %.1f million pixel pairs evaluated, "
            "%.0f %% of them blended; frame memory %.1f MB (%.0f bytes per drawn Gaussian)\n",
            view->camera_count, view->repetitions, (long long)s->gaussians, frame.pixels,
            (double)s->pairs_evaluated * 1e-6,
            s->pairs_evaluated ? 100.0 * (double)s->pairs_blended / (double)s->pairs_evaluated : 0.0,
            (double)frame.bytes * 1e-6, s->shaded ? (double)frame.bytes / (double)s->shaded : 0.0);
  return PAGS_OK;
}
