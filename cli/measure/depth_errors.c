/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: compares rendered depth with LiDAR depth samples of the views; reports median and mean error, and the
 * share of samples within 5 %. */
#include "cli/measure/depth_errors.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/sort.h"
#include "train/lidar_depth.h"

enum { MOST_SAMPLES = 200000 }; /* per view */

static const double near_share = 0.05;

void pags_depth_errors_destroy(pags_depth_errors *errors) {
  free(errors->errors);
  memset(errors, 0, sizeof *errors);
}

static pags_result reserve(pags_depth_errors *errors, int64_t more) {
  if (errors->count + more <= errors->room)
    return PAGS_OK;
  int64_t room = 2 * (errors->count + more);
  double *grown = realloc(errors->errors, (size_t)room * sizeof *grown);
  if (!grown)
    return pags_out_of_memory("%lld depths", (long long)room);
  errors->errors = grown;
  errors->room = room;
  return PAGS_OK;
}

pags_result pags_depth_errors_append(pags_depth_errors *errors, const double *more, int64_t count) {
  PAGS_TRY(reserve(errors, count));
  if (count)
    memcpy(errors->errors + errors->count, more, (size_t)count * sizeof *more);
  errors->count += count;
  return PAGS_OK;
}

static void add_sample(pags_depth_errors *errors, const pags_lidar_depth_sample *sample, const pags_picture *picture,
                       const uint8_t *mask) {
  int x = (int)sample->x, y = (int)sample->y;
  if (x < 0 || y < 0 || x >= picture->width || y >= picture->height ||
      (mask && !mask[(size_t)y * (size_t)picture->width + (size_t)x]))
    return;
  float depth = picture->depth[(size_t)y * (size_t)picture->stride + (size_t)x];
  if (!(depth > 0)) {
    errors->unblended++;
    return;
  }
  double error = fabs((double)depth - (double)sample->depth);
  errors->errors[errors->count++] = error;
  errors->within += error <= near_share * (double)sample->depth;
}

pags_result pags_depth_errors_add(pags_depth_errors *errors, const pags_dataset *dataset, int64_t view,
                                  const pags_picture *picture, const uint8_t *mask) {
  pags_lidar_depth_sample *samples;
  int64_t count;
  PAGS_TRY(pags_lidar_depth_samples(dataset, view, MOST_SAMPLES, &count, &samples));
  pags_result result = reserve(errors, count);
  for (int64_t i = 0; result == PAGS_OK && i < count; i++)
    add_sample(errors, &samples[i], picture, mask);
  free(samples);
  return result;
}

pags_depth_figures pags_depth_errors_figures(pags_depth_errors *errors) {
  double nothing = (double)NAN, sum = 0;
  pags_depth_figures out = {errors->count, nothing, nothing, nothing, nothing};
  if (!errors->count)
    return out;
  pags_sort_doubles(errors->errors, errors->count);
  int64_t most = errors->count - errors->count / 20;
  for (int64_t i = 0; i < errors->count; i++) {
    sum += errors->errors[i];
    if (i + 1 == most)
      out.mean95 = sum / (double)most;
  }
  out.median = errors->errors[errors->count / 2];
  out.mean = sum / (double)errors->count;
  out.within = (double)errors->within / (double)(errors->count + errors->unblended);
  return out;
}

void pags_depth_figures_put_json(pags_json_writer *writer, const pags_depth_figures *figures) {
  if (!figures->samples) {
    pags_json_put_null(writer, "depth");
    return;
  }
  pags_json_begin_object(writer, "depth");
  pags_json_put_integer(writer, "samples", figures->samples);
  pags_json_put_number(writer, "median", figures->median);
  pags_json_put_number(writer, "mean", figures->mean);
  pags_json_put_number(writer, "mean_95", figures->mean95);
  pags_json_put_number(writer, "within_5_percent", figures->within);
  pags_json_end_object(writer);
}
