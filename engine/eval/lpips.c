/* SPDX-License-Identifier: Apache-2.0 */
/* The perceptual distance LPIPS v0.1 (Zhang et al. 2018, arXiv:1801.03924) over SqueezeNet 1.1 or AlexNet.
 *
 *     x = (2 rgb - 1 - shift) / scale
 *     distance = sum over taps of mean over pixels of sum over channels of
 *                lin_c (a_c / (|a| + 1e-10) - b_c / (|b| + 1e-10))^2
 *
 * x is the network's input. A tap is a layer whose features a and b of the two pictures are compared. Both pictures
 * go through the network side by side, layer by layer, so that only two layers of each are in memory. */
#include "base/file.h"
#include "base/memory.h"
#include "eval/layers.h"
#include "eval/metric.h"
#include "eval/npz.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* ---- The networks ---- */

enum { NETWORKS = 2, MOST_LAYERS = 12, MOST_TAPS = 7 };

typedef enum layer_kind { CONV, POOL, FIRE } layer_kind;

typedef struct net_layer {
  layer_kind kind;
  bool tap;                         /* whether its features are compared */
  const char *name;                 /* that its arrays begin with in the file */
  int outputs, size, step, padding; /* of a convolution */
  int squeeze, expand;              /* of a fire module: channels of its first and of each of its other convolutions */
} net_layer;

typedef struct net {
  const char *name;
  bool partial_pool; /* whether windows of its pools extend beyond the map */
  int layer_count;
  net_layer layers[MOST_LAYERS]; /* the first is a convolution of 3 channels */
} net;

static const net networks[NETWORKS] = {
    {.name = "SqueezeNet 1.1",
     .partial_pool = true,
     .layer_count = 12,
     .layers = {{.kind = CONV, .tap = true, .name = "conv1", .outputs = 64, .size = 3, .step = 2},
                {.kind = POOL},
                {.kind = FIRE, .name = "fire2", .squeeze = 16, .expand = 64},
                {.kind = FIRE, .tap = true, .name = "fire3", .squeeze = 16, .expand = 64},
                {.kind = POOL},
                {.kind = FIRE, .name = "fire4", .squeeze = 32, .expand = 128},
                {.kind = FIRE, .tap = true, .name = "fire5", .squeeze = 32, .expand = 128},
                {.kind = POOL},
                {.kind = FIRE, .tap = true, .name = "fire6", .squeeze = 48, .expand = 192},
                {.kind = FIRE, .tap = true, .name = "fire7", .squeeze = 48, .expand = 192},
                {.kind = FIRE, .tap = true, .name = "fire8", .squeeze = 64, .expand = 256},
                {.kind = FIRE, .tap = true, .name = "fire9", .squeeze = 64, .expand = 256}}},
    {.name = "AlexNet",
     .layer_count = 7,
     .layers = {{.kind = CONV, .tap = true, .name = "conv1", .outputs = 64, .size = 11, .step = 4, .padding = 2},
                {.kind = POOL},
                {.kind = CONV, .tap = true, .name = "conv2", .outputs = 192, .size = 5, .step = 1, .padding = 2},
                {.kind = POOL},
                {.kind = CONV, .tap = true, .name = "conv3", .outputs = 384, .size = 3, .step = 1, .padding = 1},
                {.kind = CONV, .tap = true, .name = "conv4", .outputs = 256, .size = 3, .step = 1, .padding = 1},
                {.kind = CONV, .tap = true, .name = "conv5", .outputs = 256, .size = 3, .step = 1, .padding = 1}}}};

struct pags_lpips {
  pags_npz npz; /* owns the weights that are pointed to */
  const net *network;
  pags_conv conv[MOST_LAYERS]; /* by layer; those of the kind alone are set */
  pags_fire fire[MOST_LAYERS];
  const float *lin[MOST_TAPS];
  const float *shift, *scale;
};

/* ---- Reading the weights ---- */

typedef struct loader {
  const pags_npz *npz;
  const char *path, *network;
} loader;

/* Writes extents as "64x3x11x11". */
static void put_shape(char *text, size_t size, int rank, const int64_t *shape) {
  size_t used = (size_t)snprintf(text, size, "%s", rank ? "" : "of one value");
  for (int i = 0; i < rank && used < size; i++)
    used += (size_t)snprintf(text + used, size - used, "%s%lld", i ? "x" : "", (long long)shape[i]);
}

static pags_result get(const loader *l, const char *name, int rank, const int64_t *shape, const float **data) {
  const pags_npz_array *array = pags_npz_find(l->npz, name);
  if (!array)
    return pags_fail_at(l->path, "weights of %s: expected a member '%s'", l->network, name);
  if (array->rank != rank || memcmp(array->shape, shape, (size_t)rank * sizeof *shape) != 0) {
    char found[100], expected[100];
    put_shape(found, sizeof found, array->rank, array->shape);
    put_shape(expected, sizeof expected, rank, shape);
    return pags_fail_at(l->path, "weights of %s: '%s' is %s, expected %s", l->network, name, found, expected);
  }
  for (int64_t i = 0; i < array->count; i++)
    if (!isfinite(array->data[i]))
      return pags_fail_at(l->path, "'%s': value %lld is not finite", name, (long long)i);
  *data = array->data;
  return PAGS_OK;
}

/* The arrays LAYER PART.weight and LAYER PART.bias of a convolution whose extents are set. */
static pags_result get_conv(const loader *l, const char *layer, const char *part, pags_conv *conv) {
  char name[64];
  const int64_t shape[4] = {conv->outputs, conv->inputs, conv->size, conv->size};
  snprintf(name, sizeof name, "%s%s.weight", layer, part);
  PAGS_TRY(get(l, name, 4, shape, &conv->weight));
  snprintf(name, sizeof name, "%s%s.bias", layer, part);
  return get(l, name, 1, shape, &conv->bias);
}

/* Finds the network whose layers name arrays of the file, the first layer aside, whose name all networks share. */
static pags_result find_network(const pags_npz *npz, const char *path, const net **out) {
  const char *found[NETWORKS] = {NULL};
  for (int n = 0; n < NETWORKS; n++)
    for (int i = 1; i < networks[n].layer_count; i++)
      for (int64_t k = 0; networks[n].layers[i].name && k < npz->count; k++) {
        const size_t length = strlen(networks[n].layers[i].name);
        if (strncmp(npz->arrays[k].name, networks[n].layers[i].name, length) == 0 && npz->arrays[k].name[length] == '.')
          found[n] = npz->arrays[k].name;
      }
  if (found[0] && found[1])
    return pags_fail_at(path, "expected the weights of one network, found '%s' of %s and '%s' of %s", found[0],
                        networks[0].name, found[1], networks[1].name);
  if (!found[0] && !found[1])
    return pags_fail_at(path,
                        "expected LPIPS weights of SqueezeNet 1.1 ('fire2.squeeze.weight', ...) or AlexNet "
                        "('conv2.weight', ...) as docs/eval.md makes them, found %lld arrays%s%s%s",
                        (long long)npz->count, npz->count ? ", the first '" : "", npz->count ? npz->arrays[0].name : "",
                        npz->count ? "'" : "");
  *out = &networks[found[0] ? 0 : 1];
  return PAGS_OK;
}

/* Finds all arrays by name and checks their shapes and that their values are finite. */
static pags_result read_network(const char *npz_path, pags_lpips *lpips) {
  PAGS_TRY(pags_npz_load(npz_path, &lpips->npz));
  PAGS_TRY(find_network(&lpips->npz, npz_path, &lpips->network));
  const loader l = {.npz = &lpips->npz, .path = npz_path, .network = lpips->network->name};
  int channels = 3, taps = 0;
  for (int i = 0; i < lpips->network->layer_count; i++) {
    const net_layer *layer = &lpips->network->layers[i];
    if (layer->kind == CONV) {
      lpips->conv[i] = (pags_conv){.inputs = channels,
                                   .outputs = layer->outputs,
                                   .size = layer->size,
                                   .step = layer->step,
                                   .padding = layer->padding};
      PAGS_TRY(get_conv(&l, layer->name, "", &lpips->conv[i]));
      channels = layer->outputs;
    } else if (layer->kind == FIRE) {
      const int s = layer->squeeze, e = layer->expand;
      pags_fire *fire = &lpips->fire[i];
      fire->squeeze = (pags_conv){.inputs = channels, .outputs = s, .size = 1, .step = 1};
      fire->expand1 = (pags_conv){.inputs = s, .outputs = e, .size = 1, .step = 1};
      fire->expand3 = (pags_conv){.inputs = s, .outputs = e, .size = 3, .step = 1, .padding = 1};
      PAGS_TRY(get_conv(&l, layer->name, ".squeeze", &fire->squeeze));
      PAGS_TRY(get_conv(&l, layer->name, ".expand1x1", &fire->expand1));
      PAGS_TRY(get_conv(&l, layer->name, ".expand3x3", &fire->expand3));
      channels = 2 * e;
    }
    if (layer->tap) {
      char name[16];
      snprintf(name, sizeof name, "lin%d", taps);
      PAGS_TRY(get(&l, name, 1, &(int64_t){channels}, &lpips->lin[taps++]));
    }
  }
  PAGS_TRY(get(&l, "shift", 1, &(int64_t){3}, &lpips->shift));
  PAGS_TRY(get(&l, "scale", 1, &(int64_t){3}, &lpips->scale));
  for (int c = 0; c < 3; c++)
    if (lpips->scale[c] == 0.0f)
      return pags_fail_at(npz_path, "'scale' holds a zero");
  return PAGS_OK;
}

pags_result pags_lpips_load(const char *npz_path, pags_lpips **out) {
  *out = NULL;
  PAGS_AUTO(pags_lpips_destroy_auto) pags_lpips *lpips = calloc(1, sizeof *lpips);
  PAGS_CHECK_MEMORY(lpips, "%s", npz_path);
  PAGS_TRY(read_network(npz_path, lpips));
  *out = pags_take(&lpips);
  return PAGS_OK;
}

void pags_lpips_destroy(pags_lpips *lpips) {
  if (lpips)
    pags_npz_destroy(&lpips->npz);
  free(lpips);
}

const char *pags_lpips_network(const pags_lpips *lpips) {
  return lpips->network->name;
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
  PAGS_AUTOFREE float *scratch = calloc((size_t)width * 3 * (size_t)pags_tasks_workers(tasks), sizeof *scratch);
  PAGS_AUTOFREE double *row_sum = calloc((size_t)height, sizeof *row_sum);
  PAGS_CHECK_MEMORY(scratch && row_sum, "LPIPS");
  tap_job job = {.a = &maps[0], .b = &maps[1], .lin = lin, .scratch = scratch, .row_sum = row_sum};
  if (!pags_parallel_for(tasks, height, 4, tap_rows, &job))
    return pags_fail(PAGS_CANCELLED, "LPIPS: cancelled");
  double sum = 0.0;
  for (int y = 0; y < height; y++)
    sum += row_sum[y];
  *distance += sum / ((double)width * (double)height);
  return PAGS_OK;
}

/* ---- Both pictures through the network ---- */

/* Makes the network's input: normalised colours, in as many phases as the first convolution has steps. */
static pags_result make_input(const pags_lpips *lpips, const pags_image *image, pags_map *out) {
  const int phases = lpips->network->layers[0].step;
  PAGS_TRY(pags_map_create(out, 3, image->width, image->height, phases));
  for (int y = 0; y < image->height; y++) {
    const float *from = (const float *)image->data + (int64_t)y * image->width * 3;
    for (int c = 0; c < 3; c++)
      for (int x = 0; x < image->width; x++)
        pags_map_row(out, c + 3 * (x % phases), y)[x / phases] =
            (2.0f * pags_metric_clamp(from[3 * x + c]) - 1.0f - lpips->shift[c]) / lpips->scale[c];
  }
  return PAGS_OK;
}

static pags_result run_layer(const pags_lpips *lpips, int i, const pags_map *in, pags_tasks *tasks, pags_map *out) {
  switch (lpips->network->layers[i].kind) {
    case CONV: return pags_layer_conv(in, &lpips->conv[i], tasks, out);
    case POOL: return pags_layer_pool(in, lpips->network->partial_pool, tasks, out);
    default: return pags_layer_fire(in, &lpips->fire[i], tasks, out);
  }
}

static void destroy_maps(pags_map (*maps)[2]) {
  pags_map_destroy(&(*maps)[0]);
  pags_map_destroy(&(*maps)[1]);
}

pags_result pags_lpips_distance(const pags_lpips *lpips, const pags_image *a, const pags_image *b, pags_tasks *tasks,
                                double *distance) {
  PAGS_TRY(pags_metric_check(a, b, "LPIPS"));
  if (a->width < PAGS_LPIPS_SMALLEST || a->height < PAGS_LPIPS_SMALLEST)
    return pags_fail(PAGS_ERROR_ARGUMENT, "LPIPS: expected pictures of at least %dx%d, got %dx%d", PAGS_LPIPS_SMALLEST,
                     PAGS_LPIPS_SMALLEST, a->width, a->height);
  PAGS_AUTO(destroy_maps) pags_map maps[2] = {{0}};
  PAGS_TRY(make_input(lpips, a, &maps[0]));
  PAGS_TRY(make_input(lpips, b, &maps[1]));
  *distance = 0.0;
  for (int i = 0, taps = 0; i < lpips->network->layer_count; i++) {
    for (int k = 0; k < 2; k++) {
      PAGS_AUTO(pags_map_destroy) pags_map input = maps[k];
      maps[k] = (pags_map){0};
      PAGS_TRY(run_layer(lpips, i, &input, tasks, &maps[k]));
    }
    if (lpips->network->layers[i].tap) /* adds the distance at the tap */
      PAGS_TRY(tap_distance(maps, lpips->lin[taps++], tasks, distance));
  }
  return PAGS_OK;
}
