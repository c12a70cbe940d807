/* pags bench error: speed against error of every knob that trades one for the other, by the double-precision oracle.
 *
 * Two errors per row: to the oracle with the same options (what float arithmetic and the exp polynomial cost), and to the oracle with the
 * scene's own options (what the knob costs). In units of 1/255 of full scale, over all channels. */
#include "bench.h"

#include <math.h>
#include <string.h>
#include <tests/reference/reference.h>

typedef struct knob {
  const char *name;
  int exp_degree, sh_degree, antialiased; /* -1: the scene's own */
} knob;

static const knob knobs[] = {
    {"as the scene is", -1, -1, -1}, {"exp degree 3", 3, -1, -1},  {"SH degree 2", -1, 2, -1},    {"SH degree 1", -1, 1, -1},
    {"SH degree 0", -1, 0, -1},      {"antialiased", -1, -1, 1},   {"not antialiased", -1, -1, 0},
    {"exp 3, SH 0", 3, 0, -1},
};
enum { KNOBS = sizeof knobs / sizeof *knobs };

typedef struct error_sum {
  double largest, absolute, square, samples;
} error_sum;

static pags_frame_options turn(const pags_frame_options *options, const knob *k) {
  pags_frame_options o = *options;
  o.exp_degree = k->exp_degree >= 0 ? k->exp_degree : o.exp_degree;
  o.sh_degree = k->sh_degree >= 0 ? k->sh_degree : o.sh_degree;
  o.antialiased = k->antialiased >= 0 ? k->antialiased : o.antialiased;
  return o;
}

static void compare(const pags_picture *picture, const reference_picture *truth, error_sum *sum) {
  for (int c = 0; c < 3; c++)
    for (int y = 0; y < truth->height; y++)
      for (int x = 0; x < truth->width; x++) {
        const double want = truth->rgb[((int64_t)c * truth->height + y) * truth->width + x];
        const double off = fabs((double)picture->rgb[c][(int64_t)y * picture->stride + x] - want);
        sum->largest = off > sum->largest ? off : sum->largest;
        sum->absolute += off;
        sum->square += off * off;
        sum->samples += 1;
      }
}

static pags_result compare_views(const pags_bench_view *view, const pags_frame_options *drawn, const pags_frame_options *truth,
                                 error_sum *sum) {
  memset(sum, 0, sizeof *sum);
  pags_frame *frame;
  PAGS_TRY(pags_frame_create(view->tasks, &frame));
  reference_part parts[64];
  pags_result result = PAGS_OK;
  for (int p = 0; p < view->part_count; p++)
    parts[p] = reference_part_from(view->parts + p);
  for (int c = 0; c < view->camera_count && result == PAGS_OK; c++) {
    pags_picture picture;
    result = pags_frame_render(frame, view->parts, view->part_count, view->cameras + c, drawn, NULL, NULL, &picture);
    if (result != PAGS_OK)
      break;
    reference_picture want = reference_render(parts, view->part_count, view->cameras + c, truth);
    compare(&picture, &want, sum);
    reference_picture_destroy(&want);
  }
  for (int p = 0; p < view->part_count; p++)
    reference_part_destroy(parts + p);
  pags_frame_destroy(frame);
  return result;
}

static void put_error(pags_json_writer *json, const char *key, const error_sum *e) {
  pags_json_begin_object(json, key);
  pags_json_put_number(json, "max", e->largest);
  pags_json_put_number(json, "mean", e->absolute / e->samples);
  pags_json_put_number(json, "psnr", -10 * log10(fmax(e->square / e->samples, 1e-20)));
  pags_json_end_object(json);
}

pags_result pags_bench_error(const pags_bench_view *view, FILE *people, pags_json_writer *json) {
  if (view->part_count > 64)
    return pags_fail(PAGS_ERROR_LIMIT, "%d models; the error bench takes at most 64", view->part_count);
  pags_json_begin_object(json, "error");
  if (people)
    fprintf(people, "%-16s %9s | %-31s | %s\n%-16s %9s | %9s %10s %10s | %9s %10s %10s\n", "", "", "to the same options in double",
            "to the scene as it is, in double", "knob", "ms", "max/255", "mean/255", "PSNR", "max/255", "mean/255", "PSNR");
  for (int i = 0; i < KNOBS; i++) {
    const pags_frame_options drawn = turn(&view->options, knobs + i);
    if (i > 0 && memcmp(&drawn, &view->options, sizeof drawn) == 0)
      continue; /* what the scene is already */
    pags_bench_view turned = *view;
    turned.options = drawn;
    pags_bench_frame frame;
    error_sum same, own;
    PAGS_TRY(pags_bench_measure(&turned, 0, &frame));
    PAGS_TRY(compare_views(view, &drawn, &drawn, &same));
    PAGS_TRY(compare_views(view, &drawn, &view->options, &own));
    const pags_frame_stats *const s = &frame.stats;
    const double ms = s->ms_cull + s->ms_project + s->ms_shade + s->ms_sort + s->ms_bin + s->ms_raster;
    pags_json_begin_object(json, knobs[i].name);
    pags_json_put_number(json, "ms", ms);
    put_error(json, "to_same_options", &same);
    put_error(json, "to_scene", &own);
    pags_json_end_object(json);
    if (people)
      fprintf(people, "%-16s %9.3f | %9.4f %10.6f %10.2f | %9.4f %10.6f %10.2f\n", knobs[i].name, ms, same.largest * 255,
              same.absolute / same.samples * 255, -10 * log10(fmax(same.square / same.samples, 1e-20)), own.largest * 255,
              own.absolute / own.samples * 255, -10 * log10(fmax(own.square / own.samples, 1e-20)));
  }
  pags_json_end_object(json);
  return PAGS_OK;
}
