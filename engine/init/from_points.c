/* SPDX-License-Identifier: Apache-2.0 */
/* Makes the initial Gaussians from points, as Kerbl et al. (2023) do it: scales from the distances of the three
 * nearest neighbours. */
#include "init/from_points.h"

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stdlib.h>

#include "base/memory.h"
#include "base/sort.h"
#include "dataset/internal.h"
#include "init/knn.h"
#include "maths/maths.h"
#include "scene/morton.h"

/* Lower bound of the mean squared neighbour distance, m^2: duplicate points have distance 0. It is INRIA's bound. */
static const float least_square = 1e-7f;

/* Lower bound of the extent, relative to the median distance of the points. Cameras round an object or through a room
 * spread over more than that. */
static const double least_share = 0.25;

/* Upper bound of the initial sigma, fraction of the extent. */
static const double most_sigma = 0.1;

/* Smallest initial colour, in levels of 0..255: rendering clamps colours at 0, where no gradient flows back, so that
 * a black point cloud would stay black. */
static const double least_level = 0.5;

static int by_value(const void *a, const void *b) {
  const double left = *(const double *)a, right = *(const double *)b;
  return left < right ? -1 : left > right;
}

/* The median distance of the finite points from `centre`, of at most MOST of them; 0 without any. */
static pags_result median_distance(int64_t points, const float *xyz, const double centre[3], double *median) {
  enum { MOST = 100000 };
  const int64_t step = points / MOST + 1;
  int64_t count = 0;
  *median = 0.0;
  double *distances = malloc((size_t)(points / step + 1) * sizeof *distances);
  if (!distances)
    return pags_out_of_memory("%lld points", (long long)points);
  for (int64_t i = 0; i < points; i += step) {
    double square = 0.0;
    for (int k = 0; k < 3; k++) {
      const double d = (double)xyz[3 * i + k] - centre[k];
      square += d * d;
    }
    if (isfinite(square))
      distances[count++] = sqrt(square);
  }
  if (count > 0) {
    pags_sort(distances, count, sizeof *distances, by_value);
    *median = distances[count / 2];
  }
  free(distances);
  return PAGS_OK;
}

pags_result pags_init_extent(const pags_dataset *dataset, const int64_t *views, int64_t count, int64_t points,
                             const float *xyz, double *extent) {
  double mean[3] = {0.0, 0.0, 0.0}, centre[3], largest = 0.0, median;
  int64_t near = 0;
  for (int64_t i = 0; i < count; i++)
    near += !pags_dataset_is_far(dataset, views[i]);
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3 && !pags_dataset_is_far(dataset, views[i]); k++)
      mean[k] += pags_dataset_view(dataset, views[i])->camera.world_from_camera[4 * k + 3] / (double)near;
  for (int64_t i = 0; i < count; i++) {
    double square = 0.0;
    for (int k = 0; k < 3 && !pags_dataset_is_far(dataset, views[i]); k++) {
      double d = pags_dataset_view(dataset, views[i])->camera.world_from_camera[4 * k + 3] - mean[k];
      square += d * d;
    }
    largest = fmax(largest, sqrt(square));
  }
  for (int k = 0; k < 3; k++)
    centre[k] = mean[k] - pags_dataset_origin(dataset)[k];
  PAGS_TRY(median_distance(points, xyz, centre, &median));
  *extent = fmax(1.1 * largest, least_share * median);
  if (*extent <= 1e-6)
    *extent = 1.0;
  return PAGS_OK;
}

static bool is_finite(const float p[3]) {
  return isfinite(p[0]) && isfinite(p[1]) && isfinite(p[2]);
}

/* Writes the indices of the points to use, finite ones and at most `most` of them, to `chosen`; returns how many. */
static int64_t choose_points(int64_t points, const float *xyz, int64_t most, int64_t *chosen) {
  int64_t finite = 0, taken = 0;
  for (int64_t i = 0; i < points; i++)
    if (is_finite(xyz + 3 * i))
      chosen[finite++] = i;
  if (finite <= most)
    return finite;
  for (; taken < most; taken++) /* evenly spread over the order of the points */
    chosen[taken] = chosen[(int64_t)((double)taken * (double)finite / (double)most)];
  return taken;
}

static void fill_row(const pags_train_config *config, const float *xyz, const uint8_t *rgb, float square, double extent,
                     pags_gaussians *g, int64_t row) {
  double sigma = sqrt((double)fmaxf(square, least_square));
  float log_sigma = (float)pags_log(fmin(sigma, most_sigma * extent));
  for (int k = 0; k < 3; k++) {
    pags_plane(g, PAGS_MEAN + k)[row] = xyz[k];
    pags_plane(g, PAGS_SCALE + k)[row] = log_sigma;
    pags_plane(g, PAGS_SH + k)[row] = (float)((fmax((double)rgb[k], least_level) / 255.0 - 0.5) / PAGS_SH_C0);
  }
  pags_plane(g, PAGS_ROTATION)[row] = 1.0f;
  pags_plane(g, PAGS_OPACITY)[row] = (float)pags_log(config->start.init_opacity / (1.0 - config->start.init_opacity));
}

/* Writes the order of the points along a Morton curve. */
static pags_result order_points(int64_t count, const float *xyz, pags_tasks *tasks, int64_t *order) {
  float *const planes = malloc(3 * (size_t)count * sizeof *planes);
  if (!planes)
    return pags_out_of_memory("%lld points", (long long)count);
  for (int64_t i = 0; i < count; i++)
    for (int k = 0; k < 3; k++)
      planes[k * count + i] = xyz[3 * i + k];
  static_assert(PAGS_MEAN == 0, "means are the first planes");
  const pags_result result =
      pags_morton_order(&(pags_gaussians){.count = count, .stride = count, .data = planes}, tasks, order);
  free(planes);
  return result;
}

/* Makes the Gaussians [begin, end) of those in Morton order. `xyz` and `square` (mean squared neighbour distances)
 * belong to the chosen points in their order, `rgb` to all points. */
static pags_result sorted_rows(const pags_train_config *config, int64_t begin, int64_t end, const int64_t *order,
                               const float *xyz, const uint8_t *rgb, const int64_t *chosen, const float *square,
                               double extent, pags_gaussians *out) {
  PAGS_TRY(pags_gaussians_create(out, end - begin, config->color.sh_degree));
  if (end == begin)
    PAGS_TRY(pags_gaussians_reserve(out, 1)); /* without room there would be no columns */
  out->alpha_min = (float)config->picture.alpha_min;
  for (int64_t row = begin; row < end; row++) {
    const int64_t i = order[row];
    fill_row(config, xyz + 3 * i, rgb + 3 * chosen[i], square[i], extent, out, row - begin);
  }
  return PAGS_OK;
}

int64_t pags_init_count(int64_t points, const float *xyz, int64_t most) {
  int64_t finite = 0;
  for (int64_t i = 0; i < points; i++)
    finite += is_finite(xyz + 3 * i);
  return finite < most ? finite : most;
}

pags_result pags_init_gaussians(const pags_train_config *config, int64_t points, const float *xyz, const uint8_t *rgb,
                                int64_t most, double extent, const int64_t *rows, pags_tasks *tasks,
                                pags_gaussians *out) {
  *out = (pags_gaussians){0};
  int64_t *chosen = malloc((size_t)(points > 0 ? points : 1) * sizeof *chosen);
  int64_t count = chosen ? choose_points(points, xyz, most, chosen) : 0;
  const size_t room = (size_t)(count > 0 ? count : 1);
  float *positions = malloc(room * 4 * sizeof *positions); /* then their mean squares */
  int64_t *order = malloc(room * sizeof *order);
  pags_result result = PAGS_OK;
  if (!chosen || !positions || !order)
    result = pags_out_of_memory("%lld points", (long long)points);
  else if (count == 0)
    result = pags_fail(PAGS_ERROR_FORMAT, "the data set has no point to start from: %lld points, none finite",
                       (long long)points);
  for (int64_t i = 0; result == PAGS_OK && i < count; i++)
    for (int k = 0; k < 3; k++)
      positions[3 * i + k] = xyz[3 * chosen[i] + k];
  if (result == PAGS_OK)
    result = pags_knn_mean_squared(positions, count, tasks, positions + 3 * count);
  if (result == PAGS_OK)
    result = order_points(count, positions, tasks, order);
  if (result == PAGS_OK)
    result = sorted_rows(config, rows ? rows[0] : 0, rows ? rows[1] : count, order, positions, rgb, chosen,
                         positions + 3 * count, extent, out);
  if (result != PAGS_OK)
    pags_gaussians_destroy(out);
  free(order);
  free(positions);
  free(chosen);
  return result;
}
