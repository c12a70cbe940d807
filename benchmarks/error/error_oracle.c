/* SPDX-License-Identifier: Apache-2.0 */
/* pags-bench error, comparison with the double-precision oracle (tests/reference): float arithmetic, limits of
 * blending, exp polynomials and gradients.
 *
 * The limits of blending (alpha cut, stop, alpha cap, clamp of the slope) are fixed in the kernels, so the oracle is
 * rendered with and without each. Their gains are ratios of the oracle's time, of which blending is a smaller share
 * than in the engine, so the pair counts next to them tell more. */
#include "benchmarks/error/error.h"
#include "benchmarks/threads/pool_costs.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "maths/maths.h"
#include "reference/reference.h"
#include "simd/kernels.h"

enum { LIMITS = 4, GROUPS = 6, PROBES = 4096, EXP_VALUES = 1 << 16, KERNEL_STEPS = 1 << 16, ROUNDS = 9 };

/* Alpha cut that is practically none: it removes at most 1/256 of 1/255 of one Gaussian. */
#define LOW_CUT (REFERENCE_ALPHA_MIN / 256)

enum { NO_STOP = 1, NO_CAP = 2, NO_CLAMP = 3 };

/* The variants of the oracle, each without one limit. The cap is judged without the stop in both pictures, because
 * with the stop a Gaussian of alpha 1 would not be blended at all. The last variant is the affine image without the
 * clamp of slopes; the pictures with and without the clamp are both compared with values along rays, which the affine
 * image approximates. */
static const struct limit {
  const char *name, *exact;
  reference_limits limits;
} limits[LIMITS] = {
    {"alpha cut at 1/255",
     "cut at 1/65280, double",
     {LOW_CUT, REFERENCE_ALPHA_CAP, REFERENCE_STOP, REFERENCE_WIDENED, 0}},
    {"stop at T < 1e-4", "no stop, double", {REFERENCE_ALPHA_MIN, REFERENCE_ALPHA_CAP, 0, REFERENCE_WIDENED, 0}},
    {"alpha capped at 0.99", "cap at 1, no stop, double", {REFERENCE_ALPHA_MIN, 1, 0, REFERENCE_WIDENED, 0}},
    {"affine image, no clamp",
     "value along rays, double",
     {REFERENCE_ALPHA_MIN, REFERENCE_ALPHA_CAP, REFERENCE_STOP, INFINITY, 0}},
};

static const struct group { /* range [first, last) of parameter planes that share a unit */
  int first, last;
} groups[GROUPS] = {{PAGS_MEAN, PAGS_SCALE}, {PAGS_SCALE, PAGS_ROTATION}, {PAGS_ROTATION, PAGS_OPACITY},
                    {PAGS_OPACITY, PAGS_SH}, {PAGS_SH, PAGS_SH + 3},      {PAGS_SH + 3, PAGS_MAX_PLANES}};

typedef struct oracle {
  const pags_bench_view *view;
  reference_part parts[PAGS_BENCH_ERROR_PARTS];
  pags_frame *frame;
  float *gradient[PAGS_BENCH_ERROR_PARTS]; /* the engine's gradient: parameter p of Gaussian i at p * count + i */
  error_sum picture, decided, limit[LIMITS], affine, group[GROUPS];
  double oracle_ms, engine_ms, oracle_back_ms, engine_back_ms; /* forward; forward and backward */
  double limit_ms[LIMITS], limit_pairs[LIMITS], pairs, ray_ms;
  /* pairs of Gaussian and tile: by the squares of the 3DGS code, as the engine bins; pixel pairs evaluated */
  double squares, binned, lanes;
  double pixels, left_out; /* pixels of the gradients: all, and those left out */
} oracle;

/* ---- Tiles of the 3DGS code ---- */

/* Returns the number of tiles touched by the square of 3 sigma of the longer axis, by which the 3DGS code bins (Kerbl
 * et al. 2023). */
static double square_tiles(const reference_splat *s, int tiles_x, int tiles_y) {
  const double middle = 0.5 * (s->cov[0] + s->cov[2]);
  const double largest = middle + sqrt(fmax(0.1, middle * middle - (s->cov[0] * s->cov[2] - s->cov[1] * s->cov[1])));
  const double radius = ceil(3 * sqrt(largest)), x = s->mean2d[0], y = s->mean2d[1];
  const double x0 = fmax(0, floor((x - radius) / PAGS_TILE)), x1 = fmin(tiles_x, floor((x + radius) / PAGS_TILE) + 1);
  const double y0 = fmax(0, floor((y - radius) / PAGS_TILE)), y1 = fmin(tiles_y, floor((y + radius) / PAGS_TILE) + 1);
  return fmax(0, x1 - x0) * fmax(0, y1 - y0);
}

/* ---- Gradients ---- */

/* Whether float rounding may change a decision of the pixel: to cut, cap or stop, or which of two depths is
 * smaller. */
static bool may_turn(const reference_picture *picture, int64_t pixel) {
  return picture->margin[pixel] < 1e-4 || picture->depth_margin[pixel] < 1e-6;
}

/* Makes a pseudo-random picture gradient of the size that a loss gives; 0 at pixels where rounding may change a
 * decision, whose number is added to `left_out`. */
static double *make_weights(const reference_picture *picture, double *left_out) {
  const int64_t pixels = (int64_t)picture->width * picture->height;
  double *const weights = calloc(3 * (size_t)pixels, sizeof *weights);
  for (int64_t k = 0; weights && k < pixels; k++) {
    if (may_turn(picture, k)) {
      *left_out += 1;
      continue;
    }
    for (int c = 0; c < 3; c++)
      weights[c * pixels + k] =
          (double)(((float)((uint32_t)(c * pixels + k) * 2654435761u >> 8 & 1023) - 511.5f) / (512.0f * (float)pixels));
  }
  return weights;
}

static void receive(void *user, const pags_cluster_gradient *g, int worker) {
  const oracle *const o = user;
  const int64_t count = o->parts[g->part].count;
  (void)worker;
  for (int p = 0; p < g->planes; p++)
    memcpy(o->gradient[g->part] + p * count + g->first, g->data + (int64_t)p * g->stride,
           (size_t)g->count * sizeof(float));
}

static double length(const struct group *group, const reference_part_gradient *exact, const float *drawn, int planes,
                     int64_t row) {
  double square = 0;
  for (int p = group->first; p < group->last && p < planes; p++) {
    const double value = exact->planes[p * exact->count + row] - (drawn ? (double)drawn[p * exact->count + row] : 0);
    square += value * value;
  }
  return sqrt(square);
}

/* Adds the relative errors of the engine's gradients, per group of parameters: |difference| / max(|exact|, 1 % of the
 * group's root mean square), over the rows that have a gradient. A group whose gradients are negligible compared with
 * the others' is skipped, since it is only rounding, as for rotations if all Gaussians are round. */
static void compare_gradients(oracle *o, const reference_part_gradient *exact) {
  double size[GROUPS], largest = 0;
  for (int g = 0; g < GROUPS; g++) {
    /* Root mean square over the rows that have a gradient. */
    double square = 0, rows = 0;
    for (int p = 0; p < o->view->part_count; p++)
      for (int64_t i = 0; i < exact[p].count; i++) {
        const double l = length(&groups[g], &exact[p], NULL, pags_plane_count(o->parts[p].sh_degree), i);
        square += l * l;
        rows += l > 0;
      }
    size[g] = rows > 0 ? sqrt(square / rows) : 0;

    largest = fmax(largest, size[g]);
  }
  for (int g = 0; g < GROUPS; g++) {
    const double least = 0.01 * size[g];
    if (size[g] <= 1e-12 * largest)
      continue;
    for (int p = 0; p < o->view->part_count; p++)
      for (int64_t i = 0; i < exact[p].count; i++) {
        const int planes = pags_plane_count(o->parts[p].sh_degree);
        const double l = length(&groups[g], &exact[p], NULL, planes, i);
        if (l > 0)
          error_sum_add(&o->group[g], length(&groups[g], &exact[p], o->gradient[p], planes, i) / fmax(l, least));
      }
  }
}

/* Runs the engine's forward and backward pass with the picture gradient `weights`, padded to whole tiles. */
static pags_result go_back(oracle *o, const pags_camera *camera, const double *weights) {
  const int64_t stride = (camera->width + 15) / 16 * 16, rows = (camera->height + 15) / 16 * 16, plane = stride * rows;
  pags_frame_options options = o->view->options;
  pags_picture picture;
  pags_result result = PAGS_OK;
  float *const padded = calloc(3 * (size_t)plane, sizeof *padded);
  if (!padded)
    return pags_out_of_memory("a gradient");
  for (int c = 0; c < 3; c++)
    for (int64_t y = 0; y < camera->height; y++)
      for (int64_t x = 0; x < camera->width; x++)
        padded[c * plane + y * stride + x] = (float)weights[(c * (int64_t)camera->height + y) * camera->width + x];
  const pags_picture_gradient gradient = {.rgb = {padded, padded + plane, padded + 2 * plane}};
  options.keep_for_backward = 1;
  options.exp_degree = 5;
  for (int p = 0; p < o->view->part_count; p++)
    memset(o->gradient[p], 0, (size_t)(o->parts[p].count * pags_plane_count(o->parts[p].sh_degree)) * sizeof(float));
  /* only the second is timed: the first allocates memory */
  for (int round = 0; round < 2 && result == PAGS_OK; round++) {
    const double begin = error_clock_ms();
    result = pags_frame_render(o->frame, o->view->parts, o->view->part_count, camera, &options, NULL, NULL, &picture);
    if (result == PAGS_OK)
      result = pags_frame_backward(o->frame, &gradient, receive, o, NULL);
    o->engine_back_ms += round == 1 ? error_clock_ms() - begin : 0;
  }
  free(padded);
  return result;
}

/* Computes the oracle's gradient of its picture, whose forward pass took `forward_ms`, and compares the engine's with
 * it. */
static pags_result add_gradients(oracle *o, const pags_camera *camera, const reference_picture *picture,
                                 double forward_ms) {
  reference_part_gradient exact[PAGS_BENCH_ERROR_PARTS];
  double *const weights = make_weights(picture, &o->left_out);
  if (!weights)
    return pags_out_of_memory("a gradient");
  o->pixels += (double)picture->width * picture->height;
  const reference_picture_gradient gradient = {.rgb = weights};
  const double begin = error_clock_ms();
  reference_backward(o->parts, o->view->part_count, camera, &o->view->options, picture, &gradient, exact);
  o->oracle_back_ms += forward_ms + error_clock_ms() - begin;
  const pags_result result = go_back(o, camera, weights);
  if (result == PAGS_OK)
    compare_gradients(o, exact);
  reference_gradient_destroy(exact, o->view->part_count);
  free(weights);
  return result;
}

/* ---- Pictures ---- */

static pags_result add_engine_picture(oracle *o, const pags_camera *camera, const reference_picture *exact) {
  pags_frame_options options = o->view->options;
  pags_picture picture;
  options.count_pairs = 1;
  PAGS_TRY(pags_frame_render(o->frame, o->view->parts, o->view->part_count, camera, &options, NULL, NULL, &picture));
  o->binned += (double)pags_frame_stats_get(o->frame)->pairs_binned;
  o->lanes += (double)pags_frame_stats_get(o->frame)->pairs_evaluated;
  double *const drawn = error_picture_copy(&picture);
  if (!drawn)
    return pags_out_of_memory("a picture");
  const int64_t pixels = (int64_t)picture.width * picture.height;
  error_picture_compare(drawn, exact->rgb, 3 * pixels, &o->picture);
  for (int64_t i = 0; i < 3 * pixels; i++)
    if (!may_turn(exact, i % pixels))
      error_sum_add(&o->decided, drawn[i] - exact->rgb[i]);
  free(drawn);
  options.count_pairs = 0;
  const double begin = error_clock_ms();
  PAGS_TRY(pags_frame_render(o->frame, o->view->parts, o->view->part_count, camera, &options, NULL, NULL, &picture));
  o->engine_ms += error_clock_ms() - begin;
  return PAGS_OK;
}

/* References other than the usual picture, with which some of the variants are compared. */
typedef struct others {
  reference_picture no_stop;
  double *rays;
} others;

static void add_limit(oracle *o, int k, const pags_camera *camera, const reference_picture *usual, others *other) {
  const double begin = error_clock_ms();
  reference_picture without =
      reference_render_within(limits[k].limits, o->parts, o->view->part_count, camera, &o->view->options);
  o->limit_ms[k] += error_clock_ms() - begin;
  o->limit_pairs[k] += (double)without.contribution_count;
  const double *const held = k == NO_CAP ? other->no_stop.rgb : k == NO_CLAMP ? other->rays : usual->rgb;
  error_picture_compare(held, without.rgb, 3 * (int64_t)usual->width * usual->height, &o->limit[k]);
  if (k == NO_STOP)
    other->no_stop = without;
  else
    reference_picture_destroy(&without);
}

static void add_rays(oracle *o, const pags_camera *camera, const reference_picture *usual, others *other) {
  const double begin = error_clock_ms();
  other->rays = reference_ray_picture(o->parts, o->view->part_count, camera, &o->view->options, usual);
  o->ray_ms += error_clock_ms() - begin;
  error_picture_compare(usual->rgb, other->rays, 3 * (int64_t)usual->width * usual->height, &o->affine);
}

static pags_result add_camera(oracle *o, int index) {
  const pags_camera *const camera = o->view->cameras + index;
  const double begin = error_clock_ms();
  reference_picture usual = reference_render(o->parts, o->view->part_count, camera, &o->view->options);
  const double ms = error_clock_ms() - begin;
  o->oracle_ms += ms;
  o->pairs += (double)usual.contribution_count;

  /* Count the tiles that the 3DGS code would bin. */
  const int tiles_x = (usual.width + PAGS_TILE - 1) / PAGS_TILE, tiles_y = (usual.height + PAGS_TILE - 1) / PAGS_TILE;
  double sum = 0;
  for (int64_t i = 0; i < usual.splat_count; i++)
    sum += usual.splats[i].drawn ? square_tiles(&usual.splats[i], tiles_x, tiles_y) : 0;
  o->squares += sum;

  others other = {.rays = NULL};
  pags_result result = error_go_on(o->view, 0.5 * index / o->view->camera_count, "oracle");
  if (result == PAGS_OK)
    result = add_engine_picture(o, camera, &usual);
  if (result == PAGS_OK)
    add_rays(o, camera, &usual, &other);
  for (int k = 0; k < LIMITS && result == PAGS_OK; k++) {
    result = error_go_on(o->view, 0.5 * (index + (k + 2) / 6.0) / o->view->camera_count, "oracle");
    if (result == PAGS_OK)
      add_limit(o, k, camera, &usual, &other);
  }
  if (result == PAGS_OK)
    result = add_gradients(o, camera, &usual, ms);
  reference_picture_destroy(&other.no_stop);
  free(other.rays);
  reference_picture_destroy(&usual);
  return result;
}

/* ---- Polynomials of exp ---- */

/* Returns the alpha that the rasteriser computes for a Gaussian whose value is 2^exponent over a whole tile. */
static double kernel_alpha(const pags_kernels *kernels, int degree, float exponent) {
  float planes[4][PAGS_TILE_PIXELS] __attribute__((aligned(64)));
  const pags_splat flat = {
      .x = 8, .y = 8, .log2_opacity = exponent, .r = 1, .g = 1, .b = 1, .z = 1, .cut = -PAGS_LOG2_255};
  const pags_entry entry = {.splat = 0};
  const pags_raster_in in = {
      .splats = &flat, .entries = &entry, .count = 1, .width = PAGS_TILE, .height = PAGS_TILE, .exp_degree = degree};
  const pags_raster_out out = {
      .rgb = {planes[0], planes[1], planes[2]}, .transmittance = planes[3], .stride = PAGS_TILE};
  kernels->raster(&in, &out);
  return (double)planes[0][0];
}

static void add_exp_row(const pags_kernels *kernels, int degree, error_row *row) {
  error_sum sum = {0};
  for (int i = 0; i < PROBES; i++) {
    /* alpha from the cut (1/255) to the cap (0.99) */
    const float exponent = -7.99f + 7.97f * (float)i / (float)PROBES;
    const double exact = pags_exp2((double)exponent);
    error_sum_add(&sum, (kernel_alpha(kernels, degree, exponent) - exact) / exact);
  }
  error_sum_put(&sum, 1, row);
}

/* Time of the C library's exp2f called in a loop, ns per value. */
static double library_ns(void) {
  static float values[EXP_VALUES];
  double ns[ROUNDS];
  volatile float kept = 0;
  for (int i = 0; i < EXP_VALUES; i++)
    values[i] = -8.0f * (float)(i * 7919 % EXP_VALUES) / (float)EXP_VALUES;
  for (int round = 0; round < ROUNDS; round++) {
    const double begin = error_clock_ms();
    float sum = 0;
    for (int i = 0; i < EXP_VALUES; i++)
      sum += pags_exp2f(values[i]);
    kept = kept + sum;
    ns[round] = (error_clock_ms() - begin) * 1e6 / EXP_VALUES;
  }
  return error_median(ns, ROUNDS);
}

/* Time of one whole blending step of the kernel, ns per lane (pixel). */
static double kernel_ns(const pags_kernels *kernels, int degree) {
  double ns[ROUNDS];
  volatile float kept = 0;
  for (int round = 0; round < ROUNDS; round++) {
    const double begin = error_clock_ms();
    kept = kept + kernels->roofline(&pags_faint_splat, KERNEL_STEPS, degree);
    ns[round] = (error_clock_ms() - begin) * 1e6 / (KERNEL_STEPS * (double)PAGS_LANES);
  }
  return error_median(ns, ROUNDS);
}

static void add_exp_rows(const oracle *o, error_table *table) {
  const pags_kernels *const kernels = pags_kernels_get(NULL);
  if (!kernels)
    return;
  const double library = library_ns(), five = kernel_ns(kernels, 5), three = kernel_ns(kernels, 3);
  error_row *row = error_table_add(table, "exp by 5th degree", "exp2 in double", "relative");
  add_exp_row(kernels, 5, row);
  row->gain = (o->engine_ms + o->lanes * library * 1e-6) / o->engine_ms;
  row->gain_of = "frame, reckoned";
  row->counts[0] = (error_count){"ns a lane, exp2f alone -> whole step", library, five};
  row = error_table_add(table, "exp by 3rd degree (asked for)", "exp2 in double", "relative");
  add_exp_row(kernels, 3, row);
  row->gain = five / three;
  row->gain_of = "bare step, to 5th";
  row->counts[0] = (error_count){"ns a lane of a step", five, three};
}

/* ---- Table rows ---- */

static void add_rows(const oracle *o, error_table *table) {
  const double views = o->view->camera_count;
  error_row *row = error_table_add(table, "float, all of the engine", "double, same rules", "1/255");
  error_sum_put(&o->picture, 255, row);
  row->gain = o->oracle_ms / o->engine_ms;
  row->gain_of = "oracle's frame";
  row->counts[0] = (error_count){"bytes a number", 8, 4};
  row = error_table_add(table, "float, no decision turned", "double, same rules", "1/255");
  error_sum_put(&o->decided, 255, row);
  row->counts[0] = (error_count){"pixels, all -> compared", o->pixels, o->pixels - o->left_out};
  add_exp_rows(o, table);
  for (int k = 0; k < NO_CLAMP; k++) {
    row = error_table_add(table, limits[k].name, limits[k].exact, "1/255");
    error_sum_put(&o->limit[k], 255, row);
    const double usual_ms = k == NO_CAP ? o->limit_ms[NO_STOP] : o->oracle_ms;
    const double usual_pairs = k == NO_CAP ? o->limit_pairs[NO_STOP] : o->pairs;
    row->gain = o->limit_ms[k] / usual_ms;
    row->gain_of = "oracle's frame";
    row->counts[0] = (error_count){"pairs blended", o->limit_pairs[k] / views, usual_pairs / views};
  }
  row = error_table_add(table, "affine image, slopes clamped", "value along rays, double", "1/255");
  error_sum_put(&o->affine, 255, row);
  row->gain = o->ray_ms / o->oracle_ms;
  row->gain_of = "oracle's frame";
  row = error_table_add(table, limits[NO_CLAMP].name, limits[NO_CLAMP].exact, "1/255");
  error_sum_put(&o->limit[NO_CLAMP], 255, row);
  row->gain = o->ray_ms / o->limit_ms[NO_CLAMP];
  row->gain_of = "oracle's frame";
  row = error_table_add(table, "tiles by exact extent", "squares of 3 sigma", "none: alpha cut's");
  row->counts[0] = (error_count){"pairs with tiles", o->squares / views, o->binned / views};
  static const char *const names[GROUPS] = {"gradient by means",           "gradient by ln sigma",
                                            "gradient by rotations",       "gradient by opacities",
                                            "gradient by constant colour", "gradient by other colour"};
  for (int g = 0; g < GROUPS; g++) {
    if (o->group[g].samples == 0)
      continue;
    row = error_table_add(table, names[g], "double, same rules", "relative");
    error_sum_put(&o->group[g], 1, row);
    row->gain = g == 0 ? o->oracle_back_ms / o->engine_back_ms : (double)NAN;
    row->gain_of = g == 0 ? "oracle's both ways" : "";
  }
}

pags_result error_rows_of_oracle(const pags_bench_view *view, error_table *table) {
  oracle *const o = calloc(1, sizeof *o);
  if (!o)
    return pags_out_of_memory("the oracle");
  o->view = view;
  pags_result result = pags_frame_create(view->tasks, &o->frame);
  for (int p = 0; p < view->part_count && result == PAGS_OK; p++) {
    o->parts[p] = reference_part_from(view->parts + p);
    const size_t floats = (size_t)(o->parts[p].count * pags_plane_count(o->parts[p].sh_degree));
    o->gradient[p] = malloc((floats ? floats : 1) * sizeof(float));
    if (!o->gradient[p])
      result = pags_out_of_memory("gradients");
  }
  for (int c = 0; c < view->camera_count && result == PAGS_OK; c++)
    result = add_camera(o, c);
  if (result == PAGS_OK)
    add_rows(o, table);
  for (int p = 0; p < view->part_count; p++) {
    reference_part_destroy(o->parts + p);
    free(o->gradient[p]);
  }
  if (o->frame)
    pags_frame_destroy(o->frame);
  free(o);
  return result;
}
