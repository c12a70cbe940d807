/* SPDX-License-Identifier: Apache-2.0 */
/* pags eval: compares rendered depth with LiDAR depth samples of the views; reports median and mean error, and the
 * share of samples within 5 %. */
#include "cli/measure/errors.h"

#include <math.h>
#include "base/memory.h"
#include "base/sort.h"
#include "train/driving_losses.h"

enum { MOST_SAMPLES = 200000 }; /* per view */

static const double near_share = 0.05;

static pags_result reserve(pags_depth_errors *errors, int64_t more) {
  const int64_t needed = errors->count + more;
  PAGS_CHECK_MEMORY(pags_grow(&errors->errors, needed, &errors->capacity, sizeof *errors->errors), "%lld depths",
                    (long long)needed);
  return PAGS_OK;
}

pags_result pags_depth_errors_append(pags_depth_errors *errors, const double *more, int64_t count) {
  PAGS_TRY(reserve(errors, count));
  if (count)
    memcpy(errors->errors + errors->count, more, (size_t)count * sizeof *more);
  errors->count += count;
  return PAGS_OK;
}

pags_result pags_depth_errors_add(pags_depth_errors *errors, const pags_dataset *dataset, int64_t view,
                                  const pags_picture *picture, const uint8_t *mask) {
  PAGS_AUTOFREE pags_lidar_depth_sample *samples = NULL;
  int64_t count;
  PAGS_TRY(pags_lidar_depth_samples(dataset, view, MOST_SAMPLES, &count, &samples));
  PAGS_TRY(reserve(errors, count));
  for (int64_t i = 0; i < count; i++) {
    const int x = (int)samples[i].x, y = (int)samples[i].y;
    if (x < 0 || y < 0 || x >= picture->width || y >= picture->height ||
        (mask && !mask[(size_t)y * (size_t)picture->width + (size_t)x]))
      continue;
    const double depth = (double)picture->depth[(size_t)y * (size_t)picture->stride + (size_t)x];
    const double measured = (double)samples[i].depth, error = fabs(depth - measured);
    if (depth > 0) {
      errors->errors[errors->count++] = error;
      errors->within += error <= near_share * measured;
    } else {
      errors->unblended++;
    }
  }
  return PAGS_OK;
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
