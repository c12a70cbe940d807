/* SPDX-License-Identifier: Apache-2.0 */
/* The perceptual distance LPIPS v0.1 (Zhang et al. 2018, arXiv:1801.03924) over SqueezeNet 1.1.
 *
 *     x = (2 rgb - 1 - shift) / scale
 *     distance = sum over taps of mean over pixels of sum over channels of
 *                lin_c (a_c / (|a| + 1e-10) - b_c / (|b| + 1e-10))^2
 *
 * x is the network's input. A tap is a layer whose features a and b of the two pictures are compared. Both pictures
 * go through the network side by side, layer by layer, so that only two layers of each are in memory. */
#include "base/memory.h"
#include "eval/metric.h"
#include "eval/npz.h"
#include "eval/squeezenet.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { FIRES = 8, TAP_COUNT = 7, SMALLEST = 32 };

struct pags_lpips {
  pags_npz npz; /* owns the weights that the layers point to */
  pags_conv first;
  pags_fire fire[FIRES];
  const float *lin[TAP_COUNT];
  float shift[3], scale[3];
};

static const int squeeze_planes[FIRES] = {16, 16, 32, 32, 48, 48, 64, 64};
static const int expand_planes[FIRES] = {64, 64, 128, 128, 192, 192, 256, 256};

/* ---- Reading the weights ---- */

typedef struct loader {
  const pags_npz *npz;
  const char *path;
} loader;

static pags_result get(const loader *l, const char *name, int rank, const int64_t *shape, const float **data) {
  const pags_npz_array *array = pags_npz_find(l->npz, name);
  if (!array)
    return pags_fail(PAGS_ERROR_FORMAT, "%s: expected a member '%s'", l->path, name);
  if (array->rank != rank || memcmp(array->shape, shape, (size_t)rank * sizeof *shape) != 0)
    return pags_fail(PAGS_ERROR_FORMAT,
                     "%s: '%s' has not the shape of SqueezeNet 1.1, expected rank %d, first extent %lld", l->path, name,
                     rank, (long long)shape[0]);
  for (int64_t i = 0; i < array->count; i++)
    if (!isfinite(array->data[i]))
      return pags_fail(PAGS_ERROR_FORMAT, "%s: '%s': value %lld is not finite", l->path, name, (long long)i);
  *data = array->data;
  return PAGS_OK;
}

static pags_result get_conv(const loader *l, const char *name, int outputs, int inputs, int size, pags_conv *conv) {
  char full[64];
  const int64_t shape[4] = {outputs, inputs, size, size};
  *conv = (pags_conv){.inputs = inputs, .outputs = outputs};
  snprintf(full, sizeof full, "%s.weight", name);
  PAGS_TRY(get(l, full, 4, shape, &conv->weight));
  snprintf(full, sizeof full, "%s.bias", name);
  return get(l, full, 1, shape, &conv->bias);
}

static pags_result get_heads(const loader *l, pags_lpips *lpips) {
  static const int64_t planes[TAP_COUNT] = {64, 128, 256, 384, 384, 512, 512};
  const int64_t three = 3;
  const float *shift = NULL, *scale = NULL;
  for (int i = 0; i < TAP_COUNT; i++) {
    char name[16];
    snprintf(name, sizeof name, "lin%d", i);
    PAGS_TRY(get(l, name, 1, &planes[i], &lpips->lin[i]));
  }
  PAGS_TRY(get(l, "shift", 1, &three, &shift));
  PAGS_TRY(get(l, "scale", 1, &three, &scale));
  for (int c = 0; c < 3; c++) {
    if (scale[c] == 0.0f)
      return pags_fail(PAGS_ERROR_FORMAT, "%s: 'scale' holds a zero", l->path);
    lpips->shift[c] = shift[c];
    lpips->scale[c] = scale[c];
  }
  return PAGS_OK;
}

/* Finds all arrays by name and checks their shapes and that their values are finite. */
static pags_result read_network(const char *npz_path, pags_lpips *lpips) {
  PAGS_TRY(pags_npz_load(npz_path, &lpips->npz));
  const loader l = {.npz = &lpips->npz, .path = npz_path};
  PAGS_TRY(get_conv(&l, "conv1", 64, 3, 3, &lpips->first));
  int inputs = 64;
  for (int i = 0; i < FIRES; i++) {
    /* The three convolutions of one fire module; in the file, the modules are numbered from 2. */
    char name[32];
    const int s = squeeze_planes[i], e = expand_planes[i];
    snprintf(name, sizeof name, "fire%d.squeeze", i + 2);
    PAGS_TRY(get_conv(&l, name, s, inputs, 1, &lpips->fire[i].squeeze));
    snprintf(name, sizeof name, "fire%d.expand1x1", i + 2);
    PAGS_TRY(get_conv(&l, name, e, s, 1, &lpips->fire[i].expand1));
    snprintf(name, sizeof name, "fire%d.expand3x3", i + 2);
    PAGS_TRY(get_conv(&l, name, e, s, 3, &lpips->fire[i].expand3));

    inputs = 2 * expand_planes[i];
  }
  return get_heads(&l, lpips);
}

pags_result pags_lpips_load(const char *npz_path, pags_lpips **out) {
  *out = NULL;
  pags_lpips *lpips = calloc(1, sizeof *lpips);
  if (!lpips)
    return pags_out_of_memory("%s", npz_path);
  pags_result result = read_network(npz_path, lpips);
  if (result == PAGS_OK)
    *out = lpips;
  else
    pags_lpips_destroy(lpips);
  return result;
}

void pags_lpips_destroy(pags_lpips *lpips) {
  if (!lpips)
    return;
  pags_npz_destroy(&lpips->npz);
  free(lpips);
}

/* ---- Distance at one tap ---- */

typedef struct tap_job {
  const pags_map *a, *b;
  const float *lin;
  float *scratch;  /* three rows for each worker */
  double *row_sum; /* sum of distances of each row */
} tap_job;

/* norm[x] = 1 / (|v| + 1e-10), v being the feature vector of pixel (x, y). */
static void inverse_norms(const pags_map *map, int y, float *restrict norm) {
  for (int x = 0; x < map->width; x++)
    norm[x] = 0.0f;
  for (int c = 0; c < map->channels; c++) {
    const float *row = pags_map_row(map, c, y);
    for (int x = 0; x < map->width; x++)
      norm[x] += row[x] * row[x];
  }
  for (int x = 0; x < map->width; x++)
    norm[x] = 1.0f / (sqrtf(norm[x]) + 1e-10f);
}

static void tap_rows(void *context, int64_t begin, int64_t end, int worker) {
  const tap_job *job = context;
  const int width = job->a->width;
  float *na = job->scratch + (int64_t)worker * 3 * width, *nb = na + width, *restrict sum = nb + width;
  for (int y = (int)begin; y < (int)end; y++) {
    inverse_norms(job->a, y, na);
    inverse_norms(job->b, y, nb);
    memset(sum, 0, (size_t)width * sizeof *sum);
    for (int c = 0; c < job->a->channels; c++) {
      const float *a = pags_map_row(job->a, c, y), *b = pags_map_row(job->b, c, y), lin = job->lin[c];
      for (int x = 0; x < width; x++) {
        float d = a[x] * na[x] - b[x] * nb[x];
        sum[x] += lin * (d * d);
      }
    }
    job->row_sum[y] = 0.0;
    for (int x = 0; x < width; x++)
      job->row_sum[y] += (double)sum[x];
  }
}

static pags_result tap_distance(const pags_map maps[2], const float *lin, pags_tasks *tasks, double *distance) {
  const int width = maps[0].width, height = maps[0].height;
  tap_job job = {.a = &maps[0], .b = &maps[1], .lin = lin};
  job.scratch = calloc((size_t)width * 3 * (size_t)pags_tasks_workers(tasks), sizeof *job.scratch);
  job.row_sum = calloc((size_t)height, sizeof *job.row_sum);
  pags_result result = PAGS_OK;
  if (!job.scratch || !job.row_sum)
    result = pags_out_of_memory("LPIPS");
  else if (!pags_parallel_for(tasks, height, 4, tap_rows, &job))
    result = pags_fail(PAGS_CANCELLED, "LPIPS: cancelled");
  double sum = 0.0;
  for (int y = 0; result == PAGS_OK && y < height; y++)
    sum += job.row_sum[y];
  *distance += sum / ((double)width * (double)height);
  free(job.scratch);
  free(job.row_sum);
  return result;
}

/* ---- The network ---- */

/* Makes the network's input: normalised colours, with even and odd columns in separate planes, as pags_layer_first
 * needs them. */
static pags_result make_input(const pags_lpips *lpips, const pags_image *image, pags_map *out) {
  PAGS_TRY(pags_map_create(out, 6, (image->width + 1) / 2, image->height));
  for (int y = 0; y < image->height; y++) {
    const float *from = (const float *)image->data + (int64_t)y * image->width * 3;
    for (int c = 0; c < 3; c++)
      for (int x = 0; x < image->width; x++)
        pags_map_row(out, c + 3 * (x & 1), y)[x / 2] =
            (2.0f * pags_metric_clamp(from[3 * x + c]) - 1.0f - lpips->shift[c]) / lpips->scale[c];
  }
  return PAGS_OK;
}

/* The layers in order: conv1 > pool > fire2 3 > pool > fire4 5 > pool > fire6 7 8 9. `fire` is the index of the fire
 * module, `tap` that of the tap (and of its weights lin) after the layer; -1: none. */
typedef struct stage {
  char kind; /* c(onvolution), p(ool), f(ire) */
  int fire, tap;
} stage;

static const stage stages[] = {{'c', 0, 0}, {'p', 0, -1}, {'f', 0, -1}, {'f', 1, 1}, {'p', 0, -1}, {'f', 2, -1},
                               {'f', 3, 2}, {'p', 0, -1}, {'f', 4, 3},  {'f', 5, 4}, {'f', 6, 5},  {'f', 7, 6}};

static pags_result run_stage(const pags_lpips *lpips, const stage *s, int width, const pags_map *in, pags_tasks *tasks,
                             pags_map *out) {
  switch (s->kind) {
    case 'c': return pags_layer_first(in, width, &lpips->first, tasks, out);
    case 'p': return pags_layer_pool(in, tasks, out);
    default: return pags_layer_fire(in, &lpips->fire[s->fire], tasks, out);
  }
}

/* Runs both pictures through the network and adds up the distances at all taps. `maps` holds the inputs; on return it
 * holds maps that the caller frees, also after an error. */
static pags_result walk(const pags_lpips *lpips, int width, pags_map maps[2], pags_tasks *tasks, double *distance) {
  *distance = 0.0;
  for (size_t i = 0; i < sizeof stages / sizeof *stages; i++) {
    for (int k = 0; k < 2; k++) {
      pags_map next = {0};
      pags_result result = run_stage(lpips, &stages[i], width, &maps[k], tasks, &next);
      pags_map_destroy(&maps[k]);
      maps[k] = next;
      PAGS_TRY(result);
    }
    if (stages[i].tap >= 0)
      PAGS_TRY(tap_distance(maps, lpips->lin[stages[i].tap], tasks, distance));
  }
  return PAGS_OK;
}

pags_result pags_lpips_distance(const pags_lpips *lpips, const pags_image *a, const pags_image *b, pags_tasks *tasks,
                                double *distance) {
  PAGS_TRY(pags_metric_check(a, b, "LPIPS"));
  if (a->width < SMALLEST || a->height < SMALLEST)
    return pags_fail(PAGS_ERROR_ARGUMENT, "LPIPS: expected pictures of at least %dx%d, got %dx%d", SMALLEST, SMALLEST,
                     a->width, a->height);
  pags_map maps[2] = {{0}};
  pags_result result = make_input(lpips, a, &maps[0]);
  if (result == PAGS_OK)
    result = make_input(lpips, b, &maps[1]);
  if (result == PAGS_OK)
    result = walk(lpips, a->width, maps, tasks, distance);
  pags_map_destroy(&maps[0]);
  pags_map_destroy(&maps[1]);
  return result;
}
