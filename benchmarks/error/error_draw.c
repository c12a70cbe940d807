/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench error, approximations that the engine can switch off: renders the same views with and without each and
 * compares pictures and times.
 *
 * Timed frames alternate between the variants; a gain is the median of the ratios of neighbouring frames. */
#include "benchmarks/error/error.h"

#include <math.h>
#include <pags/packed.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "train/sh_trim.h"

enum { MOST_WAYS = 20, FINE = 4 /* samples per side of a pixel */, TRIM_VIEWS = 48, FRAMES = 2 };

/* Largest error of colour that trimming SH terms may cause: half a level of 8 bits. */
#define TRIM_ERROR (0.5 / 255.0)

/* The form of the Gaussians that is rendered. */
typedef enum content { AS_THEY_ARE, PACKED, TRIMMED, CONTENTS } content;

/* A variant of rendering: an approximation, or what approximations are compared with. */
typedef struct way {
  const char *name, *exact;
  pags_frame_options options;
  content what;
  bool fine; /* rendered FINE times as large, then averaged over FINE x FINE samples */
  int base;  /* index of the variant that this one is compared with */
  int frame; /* index of the pags_frame used; early-z has its own, since it learns from the previous frame */
  bool told; /* has a row in the table */
} way;

typedef struct drawing {
  const pags_bench_view *view;
  way ways[MOST_WAYS];
  int count;
  pags_part parts[CONTENTS][PAGS_BENCH_ERROR_PARTS];
  pags_packed packed[PAGS_BENCH_ERROR_PARTS];
  pags_gaussians trimmed[PAGS_BENCH_ERROR_PARTS];
  /* bytes of all rows; number of non-zero SH terms beyond the constant one */
  double bytes[CONTENTS], terms[CONTENTS];
  pags_frame *frames[FRAMES];
  double *pictures[MOST_WAYS]; /* of the current camera */
  error_sum sums[MOST_WAYS];
  double binned[MOST_WAYS], lanes[MOST_WAYS], shaded[MOST_WAYS];
  double *ms; /* times by variant, camera and repetition */
} drawing;

/* ---- Packed and trimmed Gaussians ---- */

static double row_bytes(const pags_gaussians *g) {
  return 4.0 * pags_plane_count(g->sh_degree) * (double)g->count;
}

static double count_terms(const pags_gaussians *g) {
  double terms = 0;
  for (int p = PAGS_SH + 3; p < pags_plane_count(g->sh_degree); p++)
    for (int64_t i = 0; i < g->count; i++)
      terms += pags_plane(g, p)[i] != 0.0f;
  return terms;
}

static pags_result pack_part(drawing *d, int p) {
  pags_part *const part = &d->parts[PACKED][p];
  d->bytes[AS_THEY_ARE] += row_bytes(part->gaussians);
  if (part->dc) { /* parts whose colour changes over time can't be packed */
    d->bytes[PACKED] += row_bytes(part->gaussians);
    return PAGS_OK;
  }
  PAGS_TRY(pags_packed_create(part->gaussians, &d->packed[p]));
  part->packed = &d->packed[p];
  part->gaussians = &d->packed[p].shape;
  part->clusters = &d->packed[p].clusters;
  d->bytes[PACKED] += (double)pags_packed_bytes(&d->packed[p]);
  return PAGS_OK;
}

typedef struct trimming {
  pags_gaussians *g;
  const pags_sh_view *views;
  int64_t view_count;
} trimming;

static void trim_block(void *context, int64_t begin, int64_t end, int worker) {
  const trimming *const t = context;
  (void)worker;
  pags_sh_trim_rows(t->g, t->views, t->view_count, TRIM_ERROR, begin, end);
}

/* Makes a copy of part p whose SH terms are trimmed for the measured cameras and up to TRIM_VIEWS others of the
 * scene. Parts whose colour changes over time, or of SH degree 0, stay as they are. */
static pags_result trim_part(drawing *d, int p) {
  const pags_bench_view *const v = d->view;
  pags_part *const part = &d->parts[TRIMMED][p];
  const pags_gaussians *const from = part->gaussians;
  pags_sh_view views[64 + TRIM_VIEWS];
  int64_t count = 0;
  d->terms[AS_THEY_ARE] += count_terms(from);
  if (part->dc || from->sh_degree == 0) {
    d->terms[TRIMMED] += count_terms(from);
    return PAGS_OK;
  }
  PAGS_TRY(pags_gaussians_create_like(&d->trimmed[p], from->count, from));
  for (int plane = 0; plane < pags_plane_count(from->sh_degree); plane++)
    memcpy(pags_plane(&d->trimmed[p], plane), pags_plane(from, plane), (size_t)from->count * sizeof(float));
  if (from->s_sem)
    memcpy(d->trimmed[p].s_sem, from->s_sem, (size_t)from->count * sizeof(float));
  for (int c = 0; c < v->camera_count; c++)
    views[count++] = pags_sh_view_make(v->cameras + c, part->world_from_model, v->options.origin,
                                       (double)v->options.near_plane, (double)v->options.low_pass);
  for (int64_t i = 0; i < TRIM_VIEWS && i < v->all_count; i++)
    views[count++] = pags_sh_view_make(
        v->all + i * v->all_count / (v->all_count < TRIM_VIEWS ? v->all_count : TRIM_VIEWS), part->world_from_model,
        v->options.origin, (double)v->options.near_plane, (double)v->options.low_pass);
  trimming t = {&d->trimmed[p], views, count};
  if (!pags_parallel_for(v->tasks, from->count, 1024, trim_block, &t))
    return pags_fail(PAGS_CANCELLED, "cancelled");
  part->gaussians = &d->trimmed[p];
  d->terms[TRIMMED] += count_terms(&d->trimmed[p]);
  return PAGS_OK;
}

/* ---- Variants ---- */

static way *add_way(drawing *d, const char *name, const char *exact, int base) {
  way *const w = &d->ways[d->count++];
  *w = (way){.name = name, .exact = exact, .options = d->view->options, .base = base, .told = name != NULL};
  return w;
}

static void list_colour_ways(drawing *d) {
  static const char *const names[] = {"colour of degree 0", "colour of degree 1", "colour of degree 2"};
  int degree = 0;
  for (int p = 0; p < d->view->part_count; p++)
    degree = d->view->parts[p].gaussians->sh_degree > degree ? d->view->parts[p].gaussians->sh_degree : degree;
  for (int k = degree - 1; k >= 0; k--)
    add_way(d, names[k], "the scene's degrees", 0)->options.sh_degree = k;
  if (degree > 0)
    add_way(d, "SH trimmed to 0.5/255", "the scene's degrees", 0)->what = TRIMMED;
}

static void list_early_z_ways(drawing *d) {
  static const struct {
    const char *name;
    pags_early_z mode;
  } modes[] = {{"early-z lossless", PAGS_EARLY_Z_LOSSLESS},
               {"early-z bounded, 1/255", PAGS_EARLY_Z_BOUNDED},
               {"early-z paper", PAGS_EARLY_Z_PAPER}};
  for (int k = 0; k < 3; k++) {
    way *const w = add_way(d, modes[k].name, "off", 0);
    w->options.early_z = modes[k].mode;
    w->options.early_z_eps = 1.0f / 255.0f;
    w->frame = 1;
  }
}

/* Adds the low-pass variants. A pixel's true value is the integral over its area, which the low-pass filter
 * approximates; the reference renders FINE x FINE samples a pixel with a correspondingly smaller low-pass and
 * averages them. */
static void list_filter_ways(drawing *d) {
  const int fine = d->count;
  way *w = add_way(d, NULL, NULL, fine);
  w->fine = true;
  w->options.antialiased = 0;
  w->options.low_pass = 0.3f / (FINE * FINE);
  static const struct {
    const char *name;
    float low_pass;
    int antialiased;
  } filters[] = {
      {"low-pass 0.3 px^2", 0.3f, 0}, {"low-pass 0.1 px^2", 0.1f, 0}, {"low-pass 0.3, antialiased", 0.3f, 1}};
  for (int k = 0; k < 3; k++) {
    w = add_way(d, filters[k].name, "mean of 16 samples a pixel", fine);
    w->options.low_pass = filters[k].low_pass;
    w->options.antialiased = filters[k].antialiased;
  }
}

/* ---- Rendering a variant ---- */

static pags_result draw(drawing *d, int k, const pags_camera *camera, bool counted, pags_picture *picture) {
  const way *const w = &d->ways[k];
  pags_frame_options options = w->options;

  /* Enlarge the camera if the variant is rendered FINE times as large. */
  pags_camera out = *camera;
  const int times = w->fine ? FINE : 1;
  out.width *= times, out.height *= times;
  out.fx *= times, out.fy *= times, out.cx *= times, out.cy *= times;
  const pags_camera seen = out;

  options.count_pairs = counted;
  return pags_frame_render(d->frames[w->frame], d->parts[w->what], d->view->part_count, &seen, &options, NULL, NULL,
                           picture);
}

/* Averages blocks of FINE x FINE pixels of three planes, in place. */
static void shrink(double *planes, int width, int height) {
  const int64_t wide = (int64_t)width * FINE;
  /* in place is safe: each mean is written before the samples that are still to be read */
  for (int64_t k = 0; k < 3 * (int64_t)width * height; k++) {
    const int64_t row = k / width, x = k % width;
    double sum = 0;
    for (int64_t j = 0; j < FINE; j++)
      for (int64_t i = 0; i < FINE; i++)
        sum += planes[(row * FINE + j) * wide + x * FINE + i];
    planes[k] = sum / (FINE * FINE);
  }
}

/* ---- Measuring and table rows ---- */

static void add_counts(const drawing *d, int k, error_row *row) {
  const way *const w = &d->ways[k];
  const double views = d->view->camera_count;
  error_count *count = row->counts;
  if (w->what == PACKED)
    *count++ = (error_count){"bytes", d->bytes[AS_THEY_ARE], d->bytes[PACKED]};
  else if (w->what == TRIMMED)
    *count++ = (error_count){"terms of colour", d->terms[AS_THEY_ARE], d->terms[TRIMMED]};
  else if (w->options.early_z != PAGS_EARLY_Z_OFF || w->options.rest_cut > 0)
    *count++ = (error_count){"shaded", d->shaded[w->base] / views, d->shaded[k] / views};
  if (d->lanes[k] != d->lanes[w->base])
    *count = (error_count){"pixel pairs", d->lanes[w->base] / views, d->lanes[k] / views};
}

static pags_result run(drawing *d) {
  PAGS_TRY(error_go_on(d->view, 0.5, "packing and trimming"));

  /* Make the packed and the trimmed form of every part. */
  for (int p = 0; p < d->view->part_count; p++) {
    for (int k = 0; k < CONTENTS; k++)
      d->parts[k][p] = d->view->parts[p];
    PAGS_TRY(pack_part(d, p));
    PAGS_TRY(trim_part(d, p));
  }

  for (int i = 0; i < FRAMES; i++)
    PAGS_TRY(pags_frame_create(d->view->tasks, &d->frames[i]));

  /* List the variants; the first is the exact one, without a row of its own. */
  add_way(d, NULL, NULL, 0);
  if (d->view->options.exp_degree > 3)
    add_way(d, "exp by 3rd degree", "by 5th degree", 0)->options.exp_degree = 3;
  list_colour_ways(d);
  add_way(d, "packed form", "floats", 0)->what = PACKED;
  list_early_z_ways(d);
  add_way(d, "rest cut under 1 px", "all drawn", 0)->options.rest_cut = 1;
  list_filter_ways(d);

  d->ms = malloc((size_t)(d->count + 1) * (size_t)d->view->camera_count * (size_t)d->view->repetitions * sizeof *d->ms);
  if (!d->ms)
    return pags_out_of_memory("times");

  /* Render every variant from every camera: once to count and compare, then timed. */
  const pags_bench_view *const v = d->view;
  const int64_t turns = (int64_t)v->camera_count * v->repetitions;
  for (int c = 0; c < v->camera_count; c++) {
    PAGS_TRY(error_go_on(v, 0.5 + 0.4 * c / v->camera_count, "drawing"));

    /* Render each variant with pairs counted, and compare it with the variant that it is based on. */
    const pags_camera *camera = v->cameras + c;
    for (int k = 0; k < d->count; k++) {
      pags_picture picture;
      PAGS_TRY(draw(d, k, camera, true, &picture));
      const pags_frame_stats *const s = pags_frame_stats_get(d->frames[d->ways[k].frame]);
      d->binned[k] += (double)s->pairs_binned;
      d->lanes[k] += (double)s->pairs_evaluated;
      d->shaded[k] += (double)s->shaded;
      free(d->pictures[k]);
      d->pictures[k] = error_picture_copy(&picture);
      if (!d->pictures[k])
        return pags_out_of_memory("a picture");
      if (d->ways[k].fine)
        shrink(d->pictures[k], camera->width, camera->height);
    }
    for (int k = 0; k < d->count; k++)
      error_picture_compare(d->pictures[k], d->pictures[d->ways[k].base], 3 * (int64_t)camera->width * camera->height,
                            &d->sums[k]);

    for (int r = 0; r < v->repetitions; r++)
      for (int k = 0; k < d->count; k++) {
        pags_picture picture;
        const double begin = error_clock_ms();
        PAGS_TRY(draw(d, k, v->cameras + c, false, &picture));
        d->ms[k * turns + (int64_t)c * v->repetitions + r] = error_clock_ms() - begin;
      }
  }
  return PAGS_OK;
}

pags_result error_rows_of_drawing(const pags_bench_view *view, error_table *table) {
  drawing *const d = calloc(1, sizeof *d);
  if (!d)
    return pags_out_of_memory("the error bench");
  d->view = view;
  const pags_result result = run(d);
  if (result == PAGS_OK) {
    /* Add a row for each variant that has one. */
    const int64_t turns = (int64_t)d->view->camera_count * d->view->repetitions;
    for (int k = 0; k < d->count; k++) {
      const way *const w = &d->ways[k];
      if (!w->told)
        continue;
      error_row *const row = error_table_add(table, w->name, w->exact, "1/255");
      error_sum_put(&d->sums[k], 255, row);
      double *const ratios = d->ms + (int64_t)d->count * turns;
      for (int64_t i = 0; i < turns; i++)
        ratios[i] = d->ms[w->base * turns + i] / fmax(d->ms[k * turns + i], 1e-6);
      row->gain = error_median(ratios, turns);
      row->gain_of = "frame";
      add_counts(d, k, row);
    }
  }
  for (int k = 0; k < MOST_WAYS; k++)
    free(d->pictures[k]);
  for (int p = 0; p < view->part_count; p++) {
    pags_packed_destroy(&d->packed[p]);
    pags_gaussians_destroy(&d->trimmed[p]);
  }
  for (int i = 0; i < FRAMES; i++)
    if (d->frames[i])
      pags_frame_destroy(d->frames[i]);
  free(d->ms);
  free(d);
  return result;
}
